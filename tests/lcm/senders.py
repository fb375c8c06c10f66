"""Messages as trackers, buttons and vandals send them."""

import numpy as np

from pace_drake.lcm.types import lcmt_pace_hand, lcmt_pace_operator


def hand(sequence, p_WH=(0.5, 0.0, 0.25), utime=0):
    """The bytes of a hand sample."""
    message = lcmt_pace_hand()
    message.utime, message.sequence, message.p_WH = utime, sequence, list(p_WH)
    return message.encode()


def press(event, utime=0, sender="test"):
    """The bytes of a press of a button."""
    message = lcmt_pace_operator()
    message.utime, message.sender, message.event = utime, sender, event
    return message.encode()


def vandalised(good, num, seed=0):
    """``num`` byte strings: the good ones cut off, with bits flipped, lengthened, and ones that never were any."""
    rng = np.random.default_rng(seed)
    for k in range(num):
        data = bytearray(good[k % len(good)])
        way = rng.integers(4)
        if way == 0:
            del data[rng.integers(len(data)) :]
        elif way == 1:
            for bit in rng.integers(8 * len(data), size=rng.integers(1, 9)):
                data[bit // 8] ^= 1 << bit % 8
        elif way == 2:
            data[8:] = rng.bytes(rng.integers(2 * len(data)))  # a good fingerprint, and then anything
        else:
            data = bytearray(rng.bytes(rng.integers(200)))
        yield bytes(data)

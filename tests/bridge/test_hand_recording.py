"""A hand over LCM as a demonstration: what the diagram would have sampled; what cannot be one is named in one line."""

import numpy as np
import pytest

from pace_drake.bridge.hand_recording import HandRecording, recording_of
from pace_drake.bridge.lcm_log import LoggedMessage
from pace_drake.errors import InputError
from pace_drake.lcm.config import LcmConfig
from tests.lcm.senders import hand

RATE = 60.0  # [1/s]
LABELS = ("place_rails", "P1", "1", 0.1, 0.2)


def place(time):
    return np.array([0.5 + 0.1 * np.sin(time), 0.1 * time, 0.2])


def samples(seconds, skip=lambda time: False, stamp=lambda time: time):
    times = np.arange(round(seconds * RATE) + 1) / RATE
    return [hand(k, place(t), round(1e6 * stamp(t) + 1e15)) for k, t in enumerate(times) if not skip(t)]


def shown(messages):
    recording = HandRecording()
    for message in messages:
        recording.take(message)
    return recording.demonstration(*LABELS)


def test_a_hand_becomes_a_demonstration_at_the_period_of_the_diagram():
    one = shown(samples(3.0))
    assert (one.name, one.sample_period, one.num_samples, one.synthetic) == ("place_rails/P1/1", 0.1, 31, False)
    np.testing.assert_allclose(one.p_WH, [place(0.1 * k) for k in range(31)], atol=1e-6)


def test_what_the_network_does_to_samples_does_not_matter():
    good = samples(3.0)
    rough = list(good)
    rough[40], rough[41] = rough[41], rough[40]  # the late one is left out, as the diagram does
    rough[100:100] = [*good[90:95], good[0], good[3][:20], b"", hand(100, (np.nan, 0, 0)), hand(101, (700, 0, 0))]
    np.testing.assert_allclose(shown(rough).p_WH, shown(good).p_WH, atol=1e-3)


@pytest.mark.parametrize(
    ("messages", "line"),
    [
        ([], "only 0 usable samples of the hand"),
        (
            [hand(k, (np.nan, 0.0, 0.0), k) for k in range(9)],
            "9 that cannot be used, the last: p_WH (nan, 0.0",
        ),
        ([b"time,x,y,z"] * 3, "the last: cannot be decoded as lcmt_pace_hand (ValueError)"),
        (samples(3.0, skip=lambda t: 1.0 < t < 1.3), "no usable sample for 0.30 s, from 1.00 s on, 0.2 at most; look"),
        ([hand(k, place(k)) for k in range(9)], "the tracker's clock (utime) goes from 0.000000 to 0.000000 s"),
        (samples(3.0, stamp=lambda t: t if t < 1.0 else t - 0.5), "goes from 0.983333 to 0.500000 s"),
        (samples(0.05), "takes 0.05 s, which is less than a period of 0.1 s"),
    ],
)
def test_what_cannot_be_a_demonstration_is_named(messages, line):
    with pytest.raises(InputError) as error:
        shown(messages)
    assert line in str(error.value)
    assert str(error.value).startswith("place_rails/P1/1: ")
    assert "\n" not in str(error.value)


CONFIG = LcmConfig()


def log(seconds=6.0):
    messages = [LoggedMessage(1e9 - 1.0, "PANDA_STATUS", b"")]
    return messages + [LoggedMessage(1e9 + k / RATE, "PACE_HAND", data) for k, data in enumerate(samples(seconds))]


def test_a_part_of_a_log():
    one = recording_of(log(), CONFIG, 2.0, 5.0).demonstration(*LABELS)
    assert one.num_samples == 31
    np.testing.assert_allclose(one.p_WH[0], place(1.0), atol=1e-6)  # the first message came a second before the hand
    assert recording_of(log(), CONFIG).num_samples == 361


def test_a_played_hand_is_not_taken_for_a_recording():
    marked = [*log(), LoggedMessage(1e9 + 2.0, "PACE_HAND_SYNTHETIC", b"SYNTHETIC people")]
    assert recording_of(marked, CONFIG).demonstration(*LABELS).synthetic
    assert not recording_of(marked, CONFIG, 3.5).demonstration(*LABELS).synthetic


def test_a_log_without_the_hand_says_what_is_in_it():
    with pytest.raises(InputError, match="no HAND in it, but PACE_HAND, PANDA_STATUS; name"):
        recording_of(log(), LcmConfig(person_hand_channel="HAND"))
    with pytest.raises(InputError, match=r"no PACE_HAND from 8 to 9 s; its messages lie from 1\.00 to 7\.00 s"):
        recording_of(log(), CONFIG, 8.0, 9.0)

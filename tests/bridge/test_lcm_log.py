from pathlib import Path

import pytest

from pace_drake.bridge.lcm_log import LcmLog, LoggedMessage, read_log
from pace_drake.errors import InputError

MESSAGES = [LoggedMessage(10.0 + 0.25 * k, f"CHANNEL_{k % 2}", bytes(range(k))) for k in range(20)]


def write(path: Path) -> Path:
    times = iter(message.time for message in MESSAGES)
    with LcmLog(path, clock=lambda: next(times)) as log:
        for message in MESSAGES:
            log.write(message.channel, message.data)
    return path


def test_what_was_written_is_read(tmp_path: Path) -> None:
    assert list(read_log(write(tmp_path / "log"))) == MESSAGES


def test_lcms_own_reader_reads_it_and_the_other_way_round(tmp_path: Path) -> None:
    lcm = pytest.importorskip("lcm", reason="the optional Python package lcm is not installed")
    path = write(tmp_path / "log")
    read = [(1e-6 * event.timestamp, event.channel, event.data) for event in lcm.EventLog(str(path), "r")]
    assert read == [tuple(message) for message in MESSAGES]
    log = lcm.EventLog(str(tmp_path / "theirs"), "w")
    for message in MESSAGES:
        log.write_event(round(1e6 * message.time), message.channel, message.data)
    log.close()
    assert list(read_log(tmp_path / "theirs")) == MESSAGES
    assert (tmp_path / "theirs").read_bytes() == path.read_bytes()


def test_every_message_is_there_at_once(tmp_path: Path) -> None:
    log = LcmLog(tmp_path / "log")
    for k, message in enumerate(MESSAGES, start=1):
        log.write(message.channel, message.data)
        assert len(list(read_log(tmp_path / "log"))) == k
    log.close()


@pytest.mark.parametrize("cut", [1, 10, 27, 28, 40])
def test_a_log_cut_short_ends_before_the_message_that_is_cut(tmp_path: Path, cut: int) -> None:
    path = write(tmp_path / "log")
    path.write_bytes(path.read_bytes()[:-cut])
    read = list(read_log(path))
    assert read == MESSAGES[: len(read)]
    assert len(read) == len(MESSAGES) - 1


@pytest.mark.parametrize(
    ("content", "what"),
    [(b"time,x,y,z\n0,1,2,3\n" * 10, "is no LCM log"), (b"short", "is no LCM log"), (None, "cannot read the log")],
)
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, content: bytes | None, what: str) -> None:
    path = tmp_path / "log"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=what):
        list(read_log(path))


def test_damage_is_located(tmp_path: Path) -> None:
    path = write(tmp_path / "log")
    data = bytearray(path.read_bytes())
    data[37] ^= 0xFF  # in the second sync word: the first message is 28 + 9 bytes long
    path.write_bytes(data)
    with pytest.raises(InputError, match="is damaged at byte 37"):
        list(read_log(path))


def test_a_log_is_never_overwritten(tmp_path: Path) -> None:
    path = write(tmp_path / "log")
    with pytest.raises(FileExistsError):
        LcmLog(path)


def test_an_empty_log_is_empty(tmp_path: Path) -> None:
    (tmp_path / "log").touch()
    assert list(read_log(tmp_path / "log")) == []

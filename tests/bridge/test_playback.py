from pace_drake.bridge.lcm_log import LoggedMessage
from pace_drake.bridge.playback import Playback


def logged(*times: float, channel: str = "A") -> list[LoggedMessage]:
    return [LoggedMessage(100.0 + time, channel, str(time).encode()) for time in times]


def test_time_passes_up_to_the_next_message() -> None:
    playback = Playback(logged(0.0, 0.004, 0.009, 0.5))
    heard: list[bytes] = []
    playback.Subscribe("A", heard.append)
    times = []
    while not playback.over:
        playback.HandleSubscriptions(5)
        times.append(round(playback.clock() - 100.0, 6))
    assert heard == [b"0.0", b"0.004", b"0.009", b"0.5"]
    assert times[:3] == [0.0, 0.004, 0.009]
    assert times[3] == 0.014  # nothing came within 5 ms
    assert times[-1] == 0.5


def test_messages_of_one_instant_come_together_and_a_step_back_stops_the_clock() -> None:
    playback = Playback(logged(0.0, 0.0, -0.001, 0.01))
    heard: list[bytes] = []
    playback.Subscribe("A", heard.append)
    assert playback.HandleSubscriptions(5) == 3
    assert playback.clock() == 100.0


def test_omitted_channels_and_those_nobody_subscribed_to_are_silent() -> None:
    playback = Playback([*logged(0.0), *logged(0.0, channel="B"), *logged(0.0, channel="C")], omitted=("B",))
    heard: list[bytes] = []
    playback.Subscribe("A", heard.append)
    playback.Subscribe("B", heard.append)
    assert playback.HandleSubscriptions(5) == 1
    assert heard == [b"0.0"]


def test_what_is_published_is_kept_and_not_heard() -> None:
    playback = Playback(logged(0.0))
    heard: list[bytes] = []
    playback.Subscribe("B", heard.append)
    playback.Publish("B", b"x")
    playback.HandleSubscriptions(5)
    assert playback.sent == [LoggedMessage(100.0, "B", b"x")]
    assert heard == []


def test_an_empty_log_is_over() -> None:
    assert Playback([]).over


def test_time_in_which_nobody_looked_passes_at_once() -> None:
    """Nine messages together after half a second were waiting; one alone had not come."""
    waiting = [0.5 + 3e-5 * k for k in range(9)]
    playback = Playback(logged(0.0, *waiting))
    heard: list[bytes] = []
    playback.Subscribe("A", heard.append)
    assert playback.HandleSubscriptions(10) == 1
    assert playback.HandleSubscriptions(10) == 9
    assert round(playback.clock() - 100.0, 3) == 0.5
    alone = Playback(logged(0.0, 0.5))
    alone.Subscribe("A", heard.append)
    assert [alone.HandleSubscriptions(10) for _ in range(3)] == [1, 0, 0]
    assert round(alone.clock() - 100.0, 3) == 0.02

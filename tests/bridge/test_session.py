from dataclasses import replace

import numpy as np
import pytest
from drake import lcmt_panda_status

from pace_drake.bridge.command_check import command_differences
from pace_drake.bridge.lcm_log import LcmLog
from pace_drake.bridge.playback import Playback
from pace_drake.bridge.preflight import preflight
from pace_drake.bridge.retrace import episode_to_json, read_episode, retrace
from pace_drake.bridge.session import Session
from pace_drake.errors import InputError
from pace_drake.evaluate.event_log import COLUMNS, EventRecorder, event_row
from pace_drake.lcm.types import lcmt_pace_decision, lcmt_pace_hand
from pace_drake.safety.command_gate import GateMode
from tests.bridge.rig import ACKNOWLEDGE, STOP, Rig


class Rows:
    """Rows as events.csv holds them."""

    def __init__(self, rig: Rig) -> None:
        self.rows: list[dict[str, str]] = []
        self._begun = False
        self._rig = rig
        self._recorder = EventRecorder(self.write)

    def write(self, time: float, kind: str, **values) -> None:
        row = {**dict.fromkeys(COLUMNS, ""), **event_row(time, kind, **values)}
        self.rows.append({name: str(value) for name, value in row.items()})

    def __call__(self, simulation, before: bool) -> None:
        if not self._begun:
            self._begun = True
            self.write(simulation.time, "episode", name="start")
        self._recorder(simulation, before)


@pytest.fixture(scope="module")
def played(parts):
    """A whole collaboration, with a stop of the operator's in it."""
    rig = Rig(*parts)
    rows = Rows(rig)
    rig.begin(rows)
    for leaf in ("PREP", "JOINT", "HOMING"):
        rig.run_until(lambda leaf=leaf: rig.leaf == leaf, 60.0).run(1.0)
        rig.session.press(STOP)
        rig.run(1.5).resume()
    rig.run_until(lambda: rig.session.finished, 300.0)
    return rig, rows.rows


def test_the_collaboration_comes_to_its_end_within_the_limits(played):
    rig, rows = played
    check = rig.check()
    assert check.kept, check
    assert check.num_streams == 1
    assert check.start == 0.0
    assert 0.0 < check.tracking_rms < check.tracking < 0.02
    names = [row["name"] for row in rows if row["kind"] == "reaction"]
    assert [name for name in names if name in ("j_done", "h_end")] == ["j_done", "j_done", "j_done", "h_end"]
    assert [line for line in rig.lines if line.startswith(("fault", "stop:"))] == []
    assert names.count("t_stop") == names.count("s_reissue") == 3
    assert rig.session.loop.stalled == 0.0


def test_the_task_level_makes_the_same_decisions_given_what_happened(played, parts):
    rig, rows = played
    scenario, people, _ = parts
    again = retrace(rows, scenario, rig.policy, rig.episode, people)
    assert again.difference == ""
    assert again.equal
    assert again.num_decisions == len([row for row in rows if row["kind"] == "decision"]) >= 3


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda row: {**row, "assist": str(1 - int(row["assist"]))}, "assist"),
        (lambda row: {**row, "phase": repr(float(row["phase"]) + 1e-9)}, "phase"),
        (lambda row: {**row, "elapsed": repr(float(row["elapsed"]) + 0.01)}, "elapsed"),
    ],
)
def test_a_decision_that_the_task_level_would_not_make_is_found(played, parts, change, what):
    rig, rows = played
    scenario, people, _ = parts
    decisions = [k for k, row in enumerate(rows) if row["kind"] == "decision"]
    changed = [change(row) if k == decisions[1] else row for k, row in enumerate(rows)]
    again = retrace(changed, scenario, rig.policy, rig.episode, people)
    assert not again.equal
    assert again.num_equal == 1
    assert again.difference.startswith(f"decision 2: {what} ")


def test_motions_that_took_longer_change_when_things_are_decided(played, parts):
    """The recorded durations are what is played: others lead to other times."""
    rig, rows = played
    scenario, people, _ = parts
    first = next(k for k, row in enumerate(rows) if row["kind"] == "command" and row["name"] == "ROBOT_TASK")
    late = {**rows[first], "time": repr(float(rows[first]["time"]) - 0.5)}
    again = retrace([*rows[:first], late, *rows[first + 1 :]], scenario, rig.policy, rig.episode, people)
    assert not again.equal


def test_events_before_the_beginning_cannot_be_retraced(played, parts):
    scenario, people, _ = parts
    with pytest.raises(InputError, match="had not begun"):
        retrace([], scenario, played[0].policy, played[0].episode, people)


def test_decisions_are_published(played):
    rig, rows = played
    sent = [lcmt_pace_decision.decode(m.data) for m in rig.messages if m.channel == rig.scenario.lcm.decision_channel]
    decided = [row for row in rows if row["kind"] == "decision"]
    assert [(round(m.time, 6), m.assist, m.phase) for m in sent] == [
        (round(float(row["time"]), 6), int(row["assist"]), float(row["phase"])) for row in decided
    ]


def test_a_replay_of_the_log_commands_the_same(played, parts):
    rig, _ = played
    scenario, people, motions = parts
    own = (scenario.lcm.panda_command_channel, scenario.lcm.hand_command_channel, scenario.lcm.decision_channel)
    playback = Playback(rig.messages, own)
    again = Session(
        scenario,
        rig.policy,
        playback,
        people=people,
        motions=motions,
        clock=playback.clock,
        steady=playback.clock,
    )
    again.connect()
    again.begin(rig.episode)
    while not (playback.over or again.finished):
        again.step()
    assert again.finished
    channel = scenario.lcm.panda_command_channel
    there = [m for m in rig.messages if m.channel == channel]
    here = [m for m in playback.sent if m.channel == channel]
    assert len(there) > 10_000
    assert abs(len(there) - len(here)) < 10
    differences = command_differences(there, here)
    # A button is seen a tick earlier or later, where the path goes at 1 rad/s at most.
    assert np.median(differences) < 1e-6
    assert np.max(differences) < 0.02


def test_an_episode_is_written_and_read_to_the_bit(played, tmp_path):
    import json

    episode, path = played[0].episode, tmp_path / "episode.json"
    path.write_text(json.dumps(episode_to_json(episode)))
    for name, value in episode_to_json(read_episode(path)).items():
        assert value == np.asarray(getattr(episode, name)).tolist()
    path.write_text("{")
    with pytest.raises(InputError, match=r"episode\.json: cannot read the episode"):
        read_episode(path)


# ---- before it moves


@pytest.mark.parametrize(
    ("spoil", "name"),
    [
        (lambda rig: setattr(rig.peer, "silent", True), "status"),
        (lambda rig: setattr(rig.peer, "robot_mode", lcmt_panda_status.kUserStopped), "robot mode"),
        (lambda rig: setattr(rig.peer, "position", np.array([0, 0.2, 0, -0.08, 0, 1.6, 0.8])), "joint limits"),
    ],
)
def test_what_is_not_right_is_named_before_the_arm_moves(rig, spoil, name):
    rig.run(0.3)
    assert all(check.good for check in preflight(rig.session))
    spoil(rig)
    rig.peer.hold()
    rig.run(0.3)
    failed = [check for check in preflight(rig.session) if not check.good]
    assert failed[0].name == name
    assert "\n" not in failed[0].found


def test_an_arm_that_is_too_far_away_does_not_move(parts):
    start = np.array(parts[2].home)
    start[0] += 2.1
    rig = Rig(*parts, start=start)
    rig.run(0.3)
    failed = [check for check in preflight(rig.session) if not check.good]
    assert [check.name for check in failed] == ["way to the start"]
    assert failed[0].found.startswith("joint 1 has 2.10 rad to go")
    rig.session.press(ACKNOWLEDGE)
    rig.run(0.5)
    assert rig.check().num_commands == 0
    assert [line for line in rig.lines if "the arm is too far from its path" in line]


def test_a_way_through_something_is_not_free(rig):
    session, start = rig.session, np.array(rig.peer.position)
    assert session.scene.is_free(start, start)
    lifted = start + np.array([0, -0.2, 0, 0, 0, 0, 0])
    assert session.scene.is_free(start, lifted)
    # From one side of the warehouse table to the other, with the arm stretched out low: through what stands there.
    low = np.array([-1.2, 0.75, 0, -1.75, 0, 2.5, 0.8])
    other = low * np.array([-1, 1, 1, 1, 1, 1, 1])
    assert not session.scene.is_free(low, other)


def test_an_arm_off_its_start_goes_there_slowly_and_then_begins(parts):
    start = np.array(parts[2].home) + np.array([0.2, -0.1, 0, 0, 0, 0, 0])
    rig = Rig(*parts, start=start)
    rig.begin()
    assert rig.lines[:2] == ["moving slowly to the path", "at the start"]
    check = rig.check()
    assert check.kept
    assert 0.05 < check.velocity <= 0.101


def test_no_status_is_said_in_one_line(parts):
    playback = Playback([])
    scenario, people, motions = parts
    session = Session(
        scenario, None, playback, people=people, motions=motions, clock=playback.clock, steady=playback.clock
    )
    with pytest.raises(InputError, match="no usable PANDA_STATUS message within 2 s: start the robot's driver"):
        session.connect(2.0)


def test_cameras_are_refused(parts):
    scenario, people, motions = parts
    with pytest.raises(InputError, match="perception: hardware has no cameras yet"):
        Session(replace(scenario, perception="cameras"), None, Playback([]), people=people, motions=motions)


# ---- a real person


class Tracker:
    """Sends the hand, as a tracker does."""

    def __init__(self, rig: "TrackedRig") -> None:
        self._rig, self._sequence = rig, 0
        self.silent = False

    def send(self) -> None:
        message = lcmt_pace_hand()
        self._sequence += 1
        message.utime, message.sequence = round(1e6 * self._rig.peer.wall_clock()), self._sequence
        message.p_WH = [0.9, 0.0, 0.2]
        if not self.silent:
            self._rig.queue.Publish(self._rig.scenario.lcm.person_hand_channel, message.encode())


class TrackedRig(Rig):
    """With a real person, whose hand keeps still."""

    real_person = True

    def run(self, duration: float) -> "TrackedRig":
        if not hasattr(self, "tracker"):
            self.tracker = Tracker(self)
        for k in range(round(duration / 0.005)):
            if k % 2 == 0:
                self.tracker.send()
            super().run(0.005)
        return self


@pytest.fixture
def tracked(parts):
    scenario, people, motions = parts
    human = replace(scenario.human, monitor="button")
    return TrackedRig(replace(scenario, human=human), people, motions)


def test_a_hand_that_is_not_seen_stops_the_arm_until_acknowledged(tracked):
    tracked.run(0.3)
    tracked.session.press(ACKNOWLEDGE)  # the safety monitor has seen no hand before the first sample
    tracked.run(0.7)
    tracked.work()
    tracked.tracker.silent = True
    tracked.run(1.0)
    told = [line for line in tracked.lines if line.startswith("stop")]
    assert told[-1] == "stop: the hand was not seen for 0.2 s: look after the tracker"
    assert tracked.leaf == "STOPPED"
    assert tracked.session.at_rest
    assert not next(check for check in preflight(tracked.session) if check.name == "hand").good
    fraction = tracked.fraction()
    tracked.tracker.silent = False
    tracked.run(0.5)
    assert tracked.fraction() == fraction
    tracked.resume()
    tracked.run_until(lambda: tracked.fraction() > fraction + 0.05)
    assert tracked.check().kept


def test_what_the_gripper_loses_while_the_hand_is_not_seen_is_told_as_well(tracked):
    tracked.run(0.3)
    tracked.session.press(ACKNOWLEDGE)
    tracked.run(0.7)
    tracked.work()
    tracked.run_until(lambda: tracked.peer.width < 0.041)
    tracked.run(0.5)
    tracked.tracker.silent = True
    tracked.run(0.5)
    tracked.present = False
    tracked.run(0.7)
    told = [line for line in tracked.lines if line.startswith(("fault", "stop:"))]
    assert told[-2].startswith("stop: the hand was not seen")
    assert told[-1].startswith("fault: the gripper does not hold cube_")
    assert tracked.leaf == "FAULT"


def test_without_a_tracker_nothing_moves(parts):
    scenario, people, motions = parts
    rig = TrackedRig(replace(scenario, human=replace(scenario.human, monitor="button")), people, motions)
    rig.tracker = Tracker(rig)
    rig.tracker.silent = True
    rig.run(0.5)
    failed = [check for check in preflight(rig.session) if not check.good]
    assert [(check.name, check.found) for check in failed] == [("hand", "no sample: start the tracker")]


def test_the_log_holds_what_was_heard_and_sent(played, tmp_path):
    rig, _ = played
    with LcmLog(tmp_path / "log") as log:
        for message in rig.messages[:1000]:
            log.write(message.channel, message.data)
    channels = {message.channel for message in rig.messages}
    config = rig.scenario.lcm
    assert {
        config.panda_status_channel,
        config.panda_command_channel,
        config.hand_status_channel,
        config.hand_command_channel,
        config.operator_channel,
        config.decision_channel,
        config.state_channel,
    } == channels
    assert rig.session.gate_mode == GateMode.FOLLOWING

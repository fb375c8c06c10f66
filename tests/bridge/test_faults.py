"""The fault matrix (docs/hardware.md): each is tried on an arm that moves, and what must hold after each is the same:

no command outside the limits was sent, one line said what was wrong, and after it was over and acknowledged the
interrupted action went on.
"""

from collections import deque

import numpy as np
import pytest
from drake import lcmt_panda_command, lcmt_panda_status, lcmt_schunk_wsg_status

from pace_drake.bridge.preflight import preflight
from pace_drake.lcm.types import lcmt_pace_operator
from pace_drake.safety.command_gate import GateMode
from tests.bridge.rig import ACKNOWLEDGE, STATUS_PERIOD, STOP, Rig


@pytest.fixture
def working(rig):
    return rig.work()


def assert_recovered(rig: Rig, line: str, kind: str = "fault") -> None:
    """One line was told; the state is recoverable; the interrupted action goes on; the limits were kept."""
    told = [told for told in rig.lines if told.startswith(f"{kind}: ")]
    assert len(told) == 1, rig.lines
    assert line in told[0]
    assert "\n" not in told[0]
    assert rig.leaf == {"fault": "FAULT", "stop": "STOPPED"}[kind]
    before, fraction = rig.action(), rig.fraction()
    assert 0.0 < fraction < 1.0
    rig.resume()
    assert rig.leaf == "ROBOT_TASK"
    assert rig.action() == before
    rig.run_until(lambda: rig.fraction() > fraction + 0.05)
    check = rig.check()
    assert check.kept, check
    assert check.num_commands > 300


def test_nothing_happens_without_a_fault(working):
    assert [line for line in working.lines if line.startswith(("fault", "stop"))] == []
    assert working.lines == ["moving slowly to the path", "at the start", "running"]
    assert working.check().kept


def test_status_stops(working):
    working.peer.silent = True
    working.run(1.0)
    sent = working.check().num_commands
    assert working.session.gate_mode == GateMode.SILENT
    working.run(1.0)
    assert working.check().num_commands == sent
    working.peer.silent = False
    working.run(0.5)
    assert working.check().num_commands == sent
    assert_recovered(working, "no PANDA_STATUS for 0.0")


def test_status_comes_100_ms_late(working):
    late: deque[bytes] = deque()

    def delay(channel, data):
        if channel != working.scenario.lcm.panda_status_channel:
            return [data]
        late.append(data)
        return [late.popleft()] if len(late) > 0.1 / STATUS_PERIOD else []

    working.network.tamper = delay
    working.run(1.0)
    working.network.tamper = lambda channel, data: [data]
    working.run(1.0)
    assert_recovered(working, "no PANDA_STATUS for 0.0")


def test_status_that_stays_late_means_that_the_clocks_differ(parts):
    """100 ms of delay from the start on cannot be told from clocks that differ, and is as bad."""
    rig = Rig(*parts, skew=0.1)
    rig.run(1.0)
    assert [line for line in rig.lines if "this machine's clock is +0.1" in line]
    rig.session.press(ACKNOWLEDGE)
    rig.run(1.0)
    assert rig.check().num_commands == 0


@pytest.mark.parametrize("skew", [0.2, -0.2])
def test_clock_skew_moves_nothing_and_is_named(parts, skew):
    rig = Rig(*parts, skew=skew)
    rig.run(1.0)
    failed = [check for check in preflight(rig.session) if not check.good]
    assert [check.name for check in failed] == ["clocks"]
    rig.session.begin(rig.episode)
    rig.session.press(ACKNOWLEDGE)
    rig.run(1.0)
    assert rig.check().num_commands == 0
    assert [line for line in rig.lines if f"this machine's clock is {skew:+.3f} s ahead" in line]


def test_clock_that_steps_under_way(working):
    step = lcmt_panda_status

    def shift(channel, data):
        if channel != working.scenario.lcm.panda_status_channel:
            return [data]
        status = step.decode(data)
        status.utime -= 200_000
        return [status.encode()]

    working.network.tamper = shift
    working.run(1.0)
    working.network.tamper = lambda channel, data: [data]
    working.run(1.0)
    # The stamps step back by less than a restart: the status counts as out of order, and so as absent.
    assert_recovered(working, "no PANDA_STATUS for 0.0")


def test_duplicate_and_reordered_messages_change_nothing(parts):
    def course(tamper):
        rig = Rig(*parts)
        rig.begin()
        rig.network.tamper = tamper
        rig.run(3.0)
        return [message.data[16:] for message in rig.messages if message.channel == "PANDA_COMMAND"], rig

    last: dict[str, bytes] = {}

    def twice_and_swapped(channel, data):
        # Each is heard again, and once more after the next one.
        before = last.get(channel, data)
        last[channel] = data
        return [data, data, before]

    plain, _ = course(lambda channel, data: [data])
    tampered, rig = course(twice_and_swapped)
    assert [line for line in rig.lines if line.startswith(("fault", "stop"))] == []
    assert tampered == plain
    assert rig.session.station.status.inbox.num_old > 1000
    assert rig.check().kept


def test_ten_thousand_corrupted_messages(working):
    rng = np.random.default_rng(0)
    channels, heard, press = working.scenario.lcm, 0, lcmt_pace_operator().encode()

    def corrupt(channel, data):
        nonlocal heard
        if channel == channels.panda_command_channel:  # where anything at all is somebody else's
            return [data]
        messages = [data]
        for _ in range(20):
            damaged = bytearray(data)
            kind = rng.integers(4)
            if kind == 0:
                damaged = damaged[: rng.integers(len(damaged))]
            elif kind == 1:
                damaged = bytearray(rng.bytes(len(damaged)))
            elif kind == 2:  # the fingerprint is right, the rest is noise
                damaged[8:] = rng.bytes(len(damaged) - 8)
            else:
                damaged[rng.integers(8)] ^= 1 << rng.integers(8)
            messages.append(bytes(damaged))
            heard += 1
        return messages

    working.network.tamper = corrupt
    while heard < 10_000:
        working.queue.Publish(channels.operator_channel, press)
        working.run(0.01)
    for inbox in (working.session.station.status.inbox, working.session.operator.inbox):
        assert inbox.num_bad > 1_000
    assert working.leaf == "ROBOT_TASK"
    assert working.check().kept
    assert [line for line in working.lines if line.startswith(("fault", "stop"))] == []


def test_bits_that_flip_in_the_figures_stop_the_arm_at_worst(parts):
    """A status that can be decoded but lies is a fault or is believed; no command leaves the limits either way."""
    rng = np.random.default_rng(1)
    rig = Rig(*parts).work()

    def flip(channel, data):
        if channel != rig.scenario.lcm.panda_status_channel or rng.random() > 0.05:
            return [data]
        damaged = bytearray(data)
        damaged[rng.integers(8, len(damaged))] ^= 1 << rng.integers(8)
        return [bytes(damaged)]

    rig.network.tamper = flip
    for _ in range(10):
        rig.run(0.5)
        rig.session.press(ACKNOWLEDGE)
    rig.network.tamper = lambda channel, data: [data]
    rig.run(2.0)
    if rig.leaf in ("STOPPED", "FAULT"):
        rig.resume()
    assert rig.check().kept


def test_wrong_type_on_the_channel(working):
    wrong = lcmt_schunk_wsg_status().encode()

    def replace(channel, data):
        return [wrong if channel == working.scenario.lcm.panda_status_channel else data]

    working.network.tamper = replace
    working.run(0.5)
    working.network.tamper = lambda channel, data: [data]
    working.run(0.5)
    told = [line for line in working.lines if line.startswith("fault")]
    assert "messages could not be used, the last because it cannot be decoded as lcmt_panda_status" in told[0]
    assert_recovered(working, "no PANDA_STATUS for 0.0")


@pytest.mark.parametrize(
    ("mode", "name", "kind"),
    [
        (lcmt_panda_status.kReflex, "Reflex", "fault"),
        (lcmt_panda_status.kUserStopped, "UserStopped", "stop"),
        (lcmt_panda_status.kGuiding, "Guiding", "stop"),
    ],
)
def test_robot_mode(working, mode, name, kind):
    working.peer.robot_mode = mode
    working.run(0.5)
    sent = working.check().num_commands
    if name == "Guiding":
        working.peer.position += 0.03  # somebody has moved it a little
        working.peer.hold()
    working.run(0.5)
    working.peer.robot_mode = lcmt_panda_status.kMove
    working.run(0.5)
    assert working.check().num_commands == sent
    assert_recovered(working, f"robot mode is {name}", kind)


def test_driver_killed_and_restarted(working):
    """The driver is silent for two seconds, and comes back with other clocks of its own."""
    working.peer.silent = True
    working.run(2.0)
    working.peer.hold()
    working.peer.silent = False
    working.run(0.5)
    assert_recovered(working, "no PANDA_STATUS for 0.0")


def test_a_second_sender_is_noticed(working):
    command = lcmt_panda_command()
    command.utime, command.num_joint_position, command.joint_position = 1, 7, [0.0] * 7
    working.queue.Publish("PANDA_COMMAND", command.encode())
    working.run(1.0)
    told = [line for line in working.lines if line.startswith("fault")]
    assert told == ["fault: somebody else sends on PANDA_COMMAND: stop the other program"]
    assert working.session.gate_mode == GateMode.BRAKING
    # What the other has sent stands in the log; ours alone is judged.
    working.messages = [m for m in working.messages if m.data != command.encode()]
    assert_recovered(working, "somebody else sends")


def test_a_second_bridge_refuses_before_it_moves(parts):
    rig = Rig(*parts)
    command = lcmt_panda_command()
    command.utime = 1
    for _ in range(20):
        rig.queue.Publish("PANDA_COMMAND", command.encode())
        rig.run(STATUS_PERIOD)
    failed = [check for check in preflight(rig.session) if not check.good]
    assert [check.name for check in failed] == ["nobody else commands"]
    assert "of another program on PANDA_COMMAND: stop it" in failed[0].found


def test_a_command_jump_is_refused_before_it_is_sent(working):
    """The path's clock is set ahead by half a second: what follows would be a jump."""
    action = working.session.assembly.robot_action
    context = action.GetMyMutableContextFromRoot(working.session.simulation.context)
    state = context.get_discrete_state_vector().value().copy()
    state[5] += 0.5  # path time [s]
    context.SetDiscreteState(state)
    last = [m for m in working.messages if m.channel == "PANDA_COMMAND"][-1]
    working.run(1.0)
    sent = [lcmt_panda_command.decode(m.data).joint_position for m in working.messages if m.channel == "PANDA_COMMAND"]
    before = lcmt_panda_command.decode(last.data).joint_position
    assert np.abs(np.array(sent[-1]) - before).max() < 0.12  # at full speed the jump would be 0.4 rad
    assert_recovered(working, "was refused: it would exceed the ")


def test_the_operator_stops_and_goes_on(working):
    working.session.press(STOP)
    working.run(1.0)
    assert working.leaf == "STOPPED"
    assert working.session.at_rest
    assert working.session.gate_mode == GateMode.FOLLOWING
    fraction = working.fraction()
    working.run(1.0)
    assert working.fraction() == fraction
    working.resume()
    working.run_until(lambda: working.fraction() > fraction + 0.05)
    assert working.check().kept
    assert working.lines[-2:] == ["on the path again: acknowledge to go on", "running"]


def test_a_stalled_process_stops_a_moving_arm(working):
    working.peer.step(0.5)
    working.session.step()
    working.run(0.5)
    assert_recovered(working, "this process fell more than 50 ms behind while the arm moved")

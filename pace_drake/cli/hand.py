"""``pace hand``: publishes the motion of a hand over LCM, as a tracker does."""

from collections.abc import Callable, Iterator
from math import isfinite
from typing import TYPE_CHECKING

import click

from pace_drake.cli.options import lcm_url_option, set_option

if TYPE_CHECKING:
    import numpy as np

    from pace_drake.people import People
    from pace_drake.scenario import Scenario


@click.command("hand", short_help="Publish the motion of a hand over LCM, recorded or synthetic.")
@click.argument("scenario", default="ikea_chair")
@lcm_url_option
@click.option("--hand", "recording", type=click.Path(), help="Recorded hand (.npz, .csv) instead of synthetic people.")
@click.option(
    "--rate",
    type=click.FloatRange(0, 1000, min_open=True),
    default=60.0,
    show_default=True,
    help="Samples [1/s] of the hand.",
)
@click.option(
    "--speed",
    type=click.FloatRange(0, min_open=True),
    default=1.0,
    show_default=True,
    help="1: in real time; 2: twice.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the episode played.")
@click.option("--with-robot", is_flag=True, help="Begin with the robot, wait for it, and press the button.")
@set_option
def command(
    scenario: str,
    url: str,
    recording: str | None,
    rate: float,
    speed: float,
    seed: int,
    with_robot: bool,
    overrides: tuple[str, ...],
) -> None:
    """Publish the hand of a person who works through the task of SCENARIO once, on its lcm.person_hand_channel.

    A stand-in for a tracker. This person does not wait for a robot, and does their part of a joint action as if it were
    there; with --with-robot they begin when lcm.state_channel says that the collaboration has, wait where it says that
    the robot is not ready, and say on lcm.operator_channel when they have finished something by themselves. Positions
    in world [m]; those of a recording as they stand in it.
    """
    import json
    import time
    from dataclasses import replace

    import numpy as np

    from pace_drake.errors import require
    from pace_drake.lcm.inbox import Inbox
    from pace_drake.lcm.types import lcmt_pace_hand, lcmt_pace_operator, lcmt_pace_state
    from pace_drake.lcm.url import open_lcm
    from pace_drake.people import load_people
    from pace_drake.scenario import load_scenario

    require(isfinite(rate * speed), "--rate, --speed", "must be numbers")
    extra = () if recording is None else (f"human.demonstrations={json.dumps(recording)}",)
    loaded = load_scenario(scenario, (*overrides, *extra))
    people = load_people(loaded, tracked=True)  # it stands for a tracker, whose hand nobody moves
    lcm = open_lcm(replace(loaded.lcm, url=url))
    channels, joint_actions = loaded.lcm, loaded.task.human_index_of_joint
    state = Inbox(lcm, channels.state_channel, lcmt_pace_state)
    sample, button = lcmt_pace_hand(), lcmt_pace_operator()
    button.sender, button.event = "pace hand", lcmt_pace_operator.REQUEST

    def robot_is_ready(joint: int) -> bool:
        """Whether it is for joint action l; for 0, whether it has begun to work."""
        if not with_robot:
            return True
        return state.newest is not None and (
            state.newest.leaf != "READY" if not joint else state.newest.joint_ready == joint
        )

    click.echo(f"{people.description}; on {channels.person_hand_channel}, {url}")
    played = _play(loaded, people, np.random.default_rng([seed, 0]), 1.0 / rate, robot_is_ready)
    start, before = time.monotonic(), 1
    try:
        for p_WH, action in played:
            time.sleep(max(start + sample.sequence / (rate * speed) - time.monotonic(), 0.0))
            lcm.HandleSubscriptions(0)
            sample.utime, sample.p_WH = int(1e6 * time.time()), p_WH.tolist()
            lcm.Publish(channels.person_hand_channel, sample.encode())
            if people.description.startswith("SYNTHETIC"):  # so that nobody takes it for a recording
                lcm.Publish(channels.synthetic_hand_channel, people.description.encode())
            sample.sequence += 1
            if with_robot and action > before and before not in joint_actions:
                button.utime = sample.utime
                lcm.Publish(channels.operator_channel, button.encode())
            before = action
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"{sample.sequence} samples are sent") from None
    click.echo(f"{sample.sequence} samples sent")


def _play(
    scenario: "Scenario",
    people: "People",
    rng: "np.random.Generator",
    period: float,
    robot_is_ready: Callable[[int], bool],
) -> "Iterator[tuple[np.ndarray, int]]":
    """(p_WH (3) [m], human_action) of a person, every ``period`` [s]; asks if the robot is ready for l (0: at all)."""
    from pace_drake.stations.joint_paths import joint_paths
    from pace_drake.systems.human import Human

    task = scenario.task
    human = Human(task, people.demonstrations, joint_paths(scenario.workcell, task.num_joint_actions))
    context = human.CreateDefaultContext()
    human.set_episode(context, people.sample(scenario, rng))
    names = ("p_WH", "human_action", "human_joint", "joints_done")
    p_WH, action, joint, done = (human.GetOutputPort(name) for name in names)
    values = human.AllocateDiscreteVariables()
    while not robot_is_ready(0):
        yield p_WH.Eval(context), 1
    k = 0
    while done.Eval(context)[0] < task.num_joint_actions:
        yield p_WH.Eval(context), int(action.Eval(context)[0])
        k += 1
        context.SetTime(k * period)
        at = joint.Eval(context)[0]
        human.GetInputPort("joint_ready").FixValue(context, at if robot_is_ready(int(at)) else 0.0)
        values.SetFrom(context.get_discrete_state())
        human.CalcForcedDiscreteVariableUpdate(context, values)
        context.SetDiscreteState(values)

"""``pace hand``: publishes the motion of a hand over LCM, as a tracker does."""

from collections.abc import Iterator
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
    type=click.FloatRange(0, min_open=True),
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
@set_option
def command(
    scenario: str,
    url: str,
    recording: str | None,
    rate: float,
    speed: float,
    seed: int,
    overrides: tuple[str, ...],
) -> None:
    """Publish the hand of a person who works through the task of SCENARIO once, on its lcm.person_hand_channel.

    A stand-in for a tracker. This person sees no robot: they do not wait for it, and do their part of a joint action as
    if it were there. Positions in world [m].
    """
    import json
    import time
    from dataclasses import replace

    import numpy as np

    from pace_drake.lcm.types import lcmt_pace_hand
    from pace_drake.lcm.url import open_lcm
    from pace_drake.people import load_people
    from pace_drake.scenario import load_scenario

    extra = () if recording is None else (f"human.demonstrations={json.dumps(recording)}",)
    loaded = load_scenario(scenario, (*overrides, *extra))
    people = load_people(loaded)
    lcm = open_lcm(replace(loaded.lcm, url=url))
    channel = loaded.lcm.person_hand_channel
    click.echo(f"{people.description}; on {channel}, {url}")
    message = lcmt_pace_hand()
    start = time.monotonic()
    try:
        for k, p_WH in enumerate(_hand(loaded, people, np.random.default_rng([seed, 0]), 1.0 / rate)):
            time.sleep(max(start + k / (rate * speed) - time.monotonic(), 0.0))
            message.utime, message.sequence, message.p_WH = int(1e6 * time.time()), k, p_WH.tolist()
            lcm.Publish(channel, message.encode())
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"{message.sequence} samples are sent") from None
    click.echo(f"{message.sequence + 1} samples sent")


def _hand(scenario: "Scenario", people: "People", rng: "np.random.Generator", period: float) -> "Iterator[np.ndarray]":
    """Positions (3) [m], every ``period`` [s], of a person for whom the robot is always ready."""
    from pace_drake.stations.joint_paths import joint_paths
    from pace_drake.systems.human import Human

    task = scenario.task
    human = Human(task, people.demonstrations, joint_paths(scenario.workcell, task.num_joint_actions))
    context = human.CreateDefaultContext()
    human.set_episode(context, people.sample(scenario, rng))
    joint, p_WH, done = (human.GetOutputPort(name) for name in ("human_joint", "p_WH", "joints_done"))
    values = human.AllocateDiscreteVariables()
    k = 0
    while done.Eval(context)[0] < task.num_joint_actions:
        yield p_WH.Eval(context)
        k += 1
        context.SetTime(k * period)
        human.GetInputPort("joint_ready").FixValue(context, joint.Eval(context))
        values.SetFrom(context.get_discrete_state())
        human.CalcForcedDiscreteVariableUpdate(context, values)
        context.SetDiscreteState(values)

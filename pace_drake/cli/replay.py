"""``pace replay``: the diagram on a recorded LCM log."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pace_drake.cli.options import set_option, with_values
from pace_drake.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from pace_drake.bridge.lcm_log import LoggedMessage
    from pace_drake.bridge.playback import Playback
    from pace_drake.bridge.session import Session
    from pace_drake.lcm.config import LcmConfig


@click.command("replay", short_help="Run the diagram on a recorded LCM log and show what it would have commanded.")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--scenario", help="Name or .yaml file; default the one beside the log, or ikea_chair.")
@click.option("--policy", help="Policy name or .onnx file; default the scenario's.")
@click.option(
    "--person",
    type=click.Choice(["lcm", "simulated"]),
    help="Where the hand comes from; default as in the run, or simulated.",
)
@click.option("--acknowledge", type=float, metavar="SECONDS", help="Give leave to move then, as if the operator had.")
@set_option
def command(
    log: Path,
    scenario: str | None,
    policy: str | None,
    person: str | None,
    acknowledge: float | None,
    overrides: tuple[str, ...],
) -> None:
    """Run the diagram on LOG: an LCM log, or a run folder of `pace bridge`. Nothing is sent anywhere.

    The status, the gripper's status, the hand and the operator's buttons come from the log, and its time is the
    diagram's; the robot is where it was recorded, whatever is commanded. Shows what was wrong when, what was decided,
    and how the commands compare with those in the log.
    """
    import numpy as np
    from rich.console import Console

    from pace_drake.bridge.lcm_log import log_file, read_log
    from pace_drake.bridge.playback import Playback
    from pace_drake.bridge.retrace import read_episode
    from pace_drake.bridge.session import Session
    from pace_drake.evaluate.event_log import EventRecorder
    from pace_drake.people import load_people
    from pace_drake.policies.factory import make_policy
    from pace_drake.scenario import load_scenario

    folder = log if log.is_dir() else log.parent
    messages = list(read_log(log_file(log)))
    recorded_scenario, recorded_episode = folder / "scenario.yaml", folder / "episode.json"
    if scenario is None:
        scenario = str(recorded_scenario) if recorded_scenario.exists() else "ikea_chair"
    loaded = load_scenario(scenario, with_values(overrides, policy=policy))
    config = loaded.lcm
    if not _of(messages, config.panda_status_channel):
        heard = ", ".join(sorted({message.channel for message in messages})) or "nothing"
        raise InputError(f"{log}: no {config.panda_status_channel} in it, but {heard}; set lcm.panda_status_channel")
    if person is None:
        person = "lcm" if _of(messages, config.person_hand_channel) else "simulated"

    own = (
        *(config.panda_command_channel, config.hand_command_channel),
        *(config.decision_channel, config.state_channel),
    )
    playback = Playback(messages, own)
    console = Console()
    teller = _Teller(console, playback)
    people = load_people(loaded, tracked=person == "lcm")
    session = Session(
        loaded,
        make_policy(loaded.policy, loaded),
        playback,
        real_person=person == "lcm",
        people=people,
        clock=playback.clock,
        steady=playback.clock,
        tell=teller.tell,
    )
    session.connect()
    if recorded_episode.exists():
        episode = read_episode(recorded_episode)
    else:
        episode = people.sample(loaded, np.random.default_rng(0))
    session.begin(episode, (EventRecorder(teller.note),))
    _play(session, playback, acknowledge)
    console.print(
        f"{session.station.status.inbox.num_good} status messages over {teller.time:.1f} s, "
        f"{session.station.status.inbox.num_bad} that cannot be used; {teller.num_troubles} times trouble",
        highlight=False,
    )
    _compare(console, messages, playback.sent, config)


class _Teller:
    """Prints what the session says, with the time in the log, and counts troubles."""

    def __init__(self, console: "Console", playback: "Playback") -> None:
        self._console, self._playback, self._start = console, playback, playback.clock()
        self.num_troubles = 0

    @property
    def time(self) -> float:
        """[s] since the log's first message."""
        return self._playback.clock() - self._start

    def tell(self, line: str) -> None:
        self.num_troubles += line.startswith(("fault", "stop:"))
        self._console.print(f"{self.time:8.2f} s  {line}", highlight=False, markup=False, soft_wrap=True)

    def note(self, time: float, kind: str, **values: Any) -> None:
        if kind == "decision":
            answer = {1: "assist", 0: "go on"}.get(values["assist"], "no answer")
            self.tell(f"decision: {answer}, in human action {values['human_action']} at phase {values['phase']:.2f}")


def _play(session: "Session", playback: "Playback", acknowledge: float | None) -> None:
    from pace_drake.lcm.types import lcmt_pace_operator

    while not (playback.over or session.finished):
        session.step()
        if acknowledge is not None and session.time >= acknowledge:
            session.press(lcmt_pace_operator.ACKNOWLEDGE)
            acknowledge = None


def _compare(
    console: "Console", messages: "Sequence[LoggedMessage]", sent: "Sequence[LoggedMessage]", config: "LcmConfig"
) -> None:
    """Prints whether the commands keep their limits, and how far they are from those in the log."""
    import numpy as np

    from pace_drake.bridge.command_check import check_commands, command_differences

    commanded = _of(sent, config.panda_command_channel)
    if not commanded:
        console.print("nothing would have been commanded: nobody gave leave in the log (--acknowledge SECONDS does)")
        return
    status = _of(messages, config.panda_status_channel)
    check = check_commands(sorted([*status, *commanded], key=lambda message: message.time), config)
    console.print(
        f"{len(commanded)} commands, {'all' if check.kept else 'NOT ALL'} within the limits: at most "
        f"{100 * check.velocity:.0f} % of velocity, {100 * check.acceleration:.0f} % of acceleration",
        highlight=False,
    )
    if recorded := _of(messages, config.panda_command_channel):
        difference = command_differences(recorded, commanded)
        console.print(
            f"against the {len(recorded)} commands in the log: {1e3 * np.median(difference):.1f} mrad in the median, "
            f"{1e3 * np.max(difference):.1f} at most",
            highlight=False,
        )


def _of(messages: "Sequence[LoggedMessage]", channel: str) -> "list[LoggedMessage]":
    return [message for message in messages if message.channel == channel]

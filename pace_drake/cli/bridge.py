"""``pace bridge``: the collaboration on a real arm, over LCM."""

import gc
import json
import shutil
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

import click

from pace_drake.cli.options import set_option, with_values
from pace_drake.cli.outputs import make_folder
from pace_drake.cli.run_folder import choose_folder
from pace_drake.cli.tables import idle_table, joint_names
from pace_drake.errors import InputError

if TYPE_CHECKING:
    from pace_drake.bridge.session import Session
    from pace_drake.lcm.link import LcmLink
    from pace_drake.people import People
    from pace_drake.policies import Policy
    from pace_drake.scenario import Scenario
    from pace_drake.task import Episode

#: [s] for which the diagram watches the robot before the checks.
_WATCHING_TIME = 1.0
#: [s] that an arm which is stopped gets to come to rest.
_REST_TIME = 3.0
#: What a line on the terminal means.
_KEYS = {"": "ACKNOWLEDGE", "s": "STOP", "r": "REQUEST"}


@click.command("bridge", short_help="Run the collaboration on a real arm, over LCM.")
@click.argument("scenario", default="ikea_chair")
@click.option("--lcm-url", help="Where the robot's driver is; sets lcm.url. See docs/hardware.md.")
@click.option("--policy", help="Policy name or .onnx file; default the scenario's.")
@click.option(
    "--person",
    type=click.Choice(["lcm", "simulated"]),
    default="lcm",
    show_default=True,
    help="lcm: a real person, tracked; simulated: nobody is there, a synthetic one is played.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the episode.")
@set_option
@click.option("--out", type=click.Path(path_type=Path), help="Run folder; default runs/<time>-<scenario>-bridge.")
@click.option("--yes", is_flag=True, help="Let the arm move to its start without asking; only for simulated robots.")
def command(
    scenario: str,
    lcm_url: str | None,
    policy: str | None,
    person: str,
    seed: int,
    overrides: tuple[str, ...],
    out: Path | None,
    yes: bool,
) -> None:
    """Check the robot, lead it to its start with your leave, and run SCENARIO with it (docs/hardware.md).

    While it runs: Enter acknowledges (lets the arm go on after trouble), s and Enter stops, r and Enter says that the
    person is done; so do `pace operator` and any sender of lcmt_pace_operator. Ctrl-C stops, holds and ends.

    Writes a run folder: scenario.yaml, episode.json (what was drawn), lcm.log (every message, for `pace replay`),
    events.csv, both as they happen; summary.json, timeline.png.

    This is a research aid and no safety function: keep the e-stop at hand.
    """
    from pace_drake.policies.factory import make_policy
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, with_values(overrides, lcm__url=lcm_url, policy=policy))
    if loaded.lcm.url.startswith("memq"):
        raise InputError("lcm.url is memq, where no robot is: give --lcm-url, such as udpm://239.255.76.67:7667?ttl=0")
    run = _Run(loaded, make_policy(loaded.policy, loaded), person == "lcm", seed, out, yes)
    run.execute()


class _Interrupt:
    """Ctrl-C and SIGTERM, taken note of; a second one interrupts at once."""

    def __init__(self) -> None:
        self.pressed = False
        self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}

    def _note(self, *_: object) -> None:
        if self.pressed:
            raise KeyboardInterrupt
        self.pressed = True

    def release(self) -> None:
        """Puts the handlers of before back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)


class _Run:
    """One call of the command."""

    def __init__(
        self, scenario: "Scenario", policy: "Policy", real_person: bool, seed: int, out: Path | None, yes: bool
    ) -> None:
        from rich.console import Console

        from pace_drake.bridge.synthetic import synthetic_parts
        from pace_drake.people import load_people

        self.scenario, self.policy, self.real_person, self.yes = scenario, policy, real_person, yes
        self.console = Console()
        self.out = choose_folder(out, f"{scenario.name}-bridge")
        self.people: People = load_people(scenario, tracked=real_person)
        self.played = ""  # what `pace hand` says of the hand that it sends in place of a tracker
        self.synthetic = synthetic_parts(scenario, self.people)
        self.episode = self._draw_episode(seed)
        self.lines: SimpleQueue[str] = SimpleQueue()

    def _draw_episode(self, seed: int) -> "Episode":
        import numpy as np

        return self.people.sample(self.scenario, np.random.default_rng([seed, 0]))

    def _say(self, line: str) -> None:
        self.console.print(line, highlight=False, markup=False, soft_wrap=True)

    def _hear_synthetic(self, data: bytes) -> None:
        if self.real_person and not self.played:
            self.played = f"not real: {data.decode(errors='replace')}"
            self._say(f"warning: the hand is {self.played}")

    def execute(self) -> None:
        """Runs the collaboration and writes everything."""
        from pace_drake.bridge.lcm_log import LcmLog
        from pace_drake.bridge.retrace import episode_to_json
        from pace_drake.evaluate.event_log import EventLog
        from pace_drake.files import write_whole
        from pace_drake.lcm.link import LcmLink
        from pace_drake.lcm.url import open_lcm

        lcm = open_lcm(self.scenario.lcm)
        self._say(
            "a real person, tracked over LCM"
            if self.real_person
            else f"nobody is there: the person is simulated ({self.people.description})"
        )
        if self.real_person and self.synthetic:
            self._say(
                f"warning: the person is real, but of SYNTHETIC people are: {'; '.join(self.synthetic)} "
                "(docs/hardware.md, step 6)"
            )
        make_folder(self.out)
        episode = json.dumps(episode_to_json(self.episode)) + "\n"
        write_whole(self.out / "scenario.yaml", lambda part: part.write_text(self.scenario.to_yaml(), encoding="utf-8"))
        write_whole(self.out / "episode.json", lambda part: part.write_text(episode, encoding="utf-8"))
        with LcmLog(self.out / "lcm.log") as log, EventLog(self.out / "events.csv") as events:
            interrupt = _Interrupt()
            try:
                session = self._prepare(LcmLink(lcm, log.write), interrupt)
                finished = not interrupt.pressed and self._lead(session, interrupt, events.write)
            finally:
                interrupt.release()
        self._report(session, finished)
        self._say(f"run folder: {self.out}")
        if interrupt.pressed:
            raise KeyboardInterrupt(f"the arm holds; what happened is in {self.out}")

    # ---- the run

    def _prepare(self, link: "LcmLink", interrupt: _Interrupt) -> "Session":
        """Finds the robot and checks it; where it is not ready, nothing is left of the attempt."""
        from pace_drake.bridge.session import Session

        link.Subscribe(self.scenario.lcm.synthetic_hand_channel, self._hear_synthetic)
        try:
            with self.console.status("planning the robot's motions"):
                session = Session(
                    self.scenario, self.policy, link, real_person=self.real_person, people=self.people, tell=self._say
                )
            # What the first look takes longer for is done before the robot is there, and what is alive then stays
            # alive: to look through it again and again would make the arm wait.
            session.scene.is_free(session.home, session.home)
            gc.collect()
            gc.freeze()
            session.connect()
            while session.time < _WATCHING_TIME and not interrupt.pressed:
                session.step()
            self._check(session)
        except InputError:
            shutil.rmtree(self.out)
            raise
        return session

    def _lead(self, session: "Session", interrupt: _Interrupt, write: Callable[..., None]) -> bool:
        """Leads the session to its end; whether the collaboration finished."""
        from functools import partial

        from pace_drake.evaluate.episode import SAMPLE_PERIOD, write_phase
        from pace_drake.evaluate.event_log import EventRecorder

        self._listen(session)
        write = partial(write, 0)
        recorder = EventRecorder(write)
        sampled = session.time
        session.begin(self.episode, (_Beginning(write), recorder))
        while not session.finished and not interrupt.pressed:
            session.step()
            self._take_lines(session)
            if session.begun and session.time >= sampled + SAMPLE_PERIOD:
                sampled = session.time
                write_phase(session.simulation, write)
        if session.finished:
            recorder.finish(session.time)
            write(session.time, "episode", name="finished")
            return True
        self._hold(session)
        if session.begun:
            recorder.finish(session.time)
            write(session.time, "episode", name="interrupted")
        return False

    def _check(self, session: "Session") -> None:
        from rich.table import Table

        from pace_drake.bridge.preflight import preflight

        checks = preflight(session)
        table = Table("", "check", "found", box=None)
        for check in checks:
            table.add_row("[green]ok[/green]" if check.good else "[red]no[/red]", check.name, check.found)
        self.console.print(table)
        wrong = next((check for check in checks if not check.good), None)
        if wrong is not None:
            raise InputError(f"the robot is not ready: {wrong.name}: {wrong.found}")

    def _listen(self, session: "Session") -> None:
        """Lets the operator speak."""
        from pace_drake.lcm.types import lcmt_pace_operator

        if self.yes:
            session.press(lcmt_pace_operator.ACKNOWLEDGE)
        else:
            self._say(
                "e-stop at hand, nobody within reach of the arm? Press Enter: the arm moves slowly to its start, and "
                "the collaboration begins"
            )

        def read() -> None:
            for line in sys.stdin:
                self.lines.put(line.strip())

        threading.Thread(target=read, daemon=True).start()

    def _take_lines(self, session: "Session") -> None:
        from pace_drake.lcm.types import lcmt_pace_operator

        while True:
            try:
                line = self.lines.get_nowait()
            except Empty:
                return
            if line in _KEYS:
                session.press(getattr(lcmt_pace_operator, _KEYS[line]))
            else:
                self._say("Enter acknowledges, s and Enter stops, r and Enter says that the person is done")

    @staticmethod
    def _hold(session: "Session") -> None:
        """Stops the arm on its path, and waits until it is at rest; nobody is asked to let it go on."""
        from pace_drake.lcm.types import lcmt_pace_operator

        session.tell = lambda line: None
        session.press(lcmt_pace_operator.STOP)
        end = session.time + _REST_TIME
        settled = session.time + 0.1
        while session.time < end and not (session.at_rest and session.time > settled):
            session.step()

    # ---- afterwards

    def _report(self, session: "Session", finished: bool) -> None:
        from pace_drake import __version__
        from pace_drake.bridge.command_check import check_commands
        from pace_drake.bridge.lcm_log import read_log
        from pace_drake.bridge.retrace import retrace
        from pace_drake.evaluate.episode import by_joint
        from pace_drake.evaluate.timeline import draw_timeline, read_events
        from pace_drake.files import write_whole

        scenario = self.scenario
        commands = check_commands(read_log(self.out / "lcm.log"), scenario.lcm)
        summary = {
            "pace_drake": __version__,
            "scenario": scenario.name,
            "people": (self.played or "real, tracked") if self.real_person else self.people.description,
            "synthetic": self.synthetic,
            "policy": scenario.policy,
            "level": "hardware",
            "finished": finished,
            "duration": session.time,
            "stalled": session.loop.stalled,
            "commands": commands.to_json(),
        }
        if commands.num_commands:
            self._say(
                f"{commands.num_commands} commands, {'all' if commands.kept else 'NOT ALL'} within the limits: at most "
                f"{100 * commands.velocity:.0f} % of velocity, {100 * commands.acceleration:.0f} % of acceleration, "
                f"{100 * commands.jerk:.0f} % of jerk; first command {commands.start:.1e} rad from measured"
            )
            self._say(
                f"joint error {1e3 * commands.tracking_rms:.1f} mrad rms, {1e3 * commands.tracking:.1f} at most; of "
                f"what the driver asks of the robot: {1e3 * commands.driver_rms:.1f} rms, {1e3 * commands.driver:.1f}"
            )
        if session.begun:
            events = read_events(self.out / "events.csv")
            title = f"{scenario.name}, policy {scenario.policy}, on hardware: {summary['people']}"
            write_whole(self.out / "timeline.png", lambda part: draw_timeline(events, scenario.task, title, part))
            idle = {name: by_joint(session.simulation.output(name).tolist()) for name in ("robot_idle", "human_idle")}
            summary.update(idle, cost=float(session.simulation.output("cost")[0]))
            self.console.print(
                idle_table(idle, joint_names(scenario.task), rf"idle time \[s], policy {scenario.policy}")
            )
            if not self.real_person:
                again = retrace(events, scenario, self.policy, self.episode, self.people)
                summary["retraced"] = {"decisions": again.num_decisions, "equal": again.num_equal}
                self._say(
                    f"decisions: {again.num_decisions}; the task level, given what happened, makes the same "
                    f"{again.num_equal}" + (f"; then {again.difference}" if again.difference else "")
                )
        text = json.dumps(summary, indent=1) + "\n"
        write_whole(self.out / "summary.json", lambda part: part.write_text(text, encoding="utf-8"))


class _Beginning:
    """Notes when the collaboration begins: the first reaction of a session that has."""

    def __init__(self, write: Callable[..., None]) -> None:
        self._write, self._done = write, False

    def __call__(self, simulation: object, before: bool) -> None:
        """See ``pace_drake.simulation.Listener``."""
        if not self._done:
            self._done = True
            self._write(simulation.time, "episode", name="start")  # type: ignore[attr-defined]

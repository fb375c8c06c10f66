"""``pace run``: the collaborative assembly, and who waited for whom."""

import json
import logging
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pace_drake.cli.options import set_option, with_values
from pace_drake.cli.outputs import make_folder
from pace_drake.cli.run_folder import choose_folder
from pace_drake.cli.tables import idle_table, joint_names

if TYPE_CHECKING:
    from pace_drake.diagram import Assembly
    from pace_drake.evaluate.episode import EpisodeResult
    from pace_drake.evaluate.live_panel import LivePanel
    from pace_drake.evaluate.workcell import Sort
    from pace_drake.policies import Policy
    from pace_drake.scenario import Scenario


@click.command("run", short_help="Run the collaborative assembly and show who waited for whom.")
@click.argument("scenario", default="ikea_chair")
@click.option("--policy", help="Policy name or .onnx file; default the scenario's. See 'pace scenarios'.")
@click.option(
    "--level",
    type=click.Choice(["plant", "task"]),
    default="plant",
    show_default=True,
    help="plant: the Panda, tables and cubes are simulated; task: durations only, about 20 episodes a second.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the episodes.")
@click.option("--episodes", type=click.IntRange(min=1), default=1, show_default=True, help="How many episodes.")
@click.option("--hand", type=click.Path(), help="Recorded hand (.npz, .csv) played instead of the scenario's people.")
@click.option("--chart", type=click.Path(), help="Statechart (.scxml) run instead of the scenario's.")
@click.option("--lambda", "human_idle_weight", type=float, help="Weight of human idle time in the cost, > 0.")
@set_option
@click.option("--out", type=click.Path(path_type=Path), help="Run folder; default runs/<time>-<scenario>-<policy>.")
@click.option(
    "--meshcat", is_flag=True, help="Show the plant live in a browser, on localhost only; figures in its controls."
)
def command(
    scenario: str,
    policy: str | None,
    level: str,
    seed: int,
    episodes: int,
    hand: str | None,
    chart: str | None,
    human_idle_weight: float | None,
    overrides: tuple[str, ...],
    out: Path | None,
    meshcat: bool,
) -> None:
    """Run SCENARIO (a name or a .yaml file) and show who waited for whom.

    Writes a run folder: scenario.yaml (resolved), events.csv (every reaction, decision and idle interval, written as it
    goes), summary.json, timeline.png and, at the plant level, of the first episode, replay.html and plant.npz (joints
    at every step). Times in [s].
    """
    from pace_drake.policies.factory import make_policy
    from pace_drake.scenario import load_scenario

    values = with_values(
        overrides,
        human__demonstrations=hand,
        statechart=chart,
        task__human_idle_weight=human_idle_weight,
        policy=policy,
    )
    loaded = load_scenario(scenario, values)
    chosen = make_policy(loaded.policy, loaded)
    run = _Run(loaded, chosen, level, seed, episodes, out, meshcat)
    try:
        run.execute()
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the events so far are in {run.out}") from None


class _Run:
    """One call of the command."""

    def __init__(
        self,
        scenario: "Scenario",
        policy: "Policy",
        level: str,
        seed: int,
        episodes: int,
        out: Path | None,
        show: bool,
    ) -> None:
        from rich.console import Console

        self.scenario, self.level, self.seed, self.episodes = scenario, level, seed, episodes
        self.sorts: list[Sort] = []
        self.console = Console()
        self.out = choose_folder(out, f"{scenario.name}-{Path(scenario.policy).stem}")
        self.live: LivePanel | None = None
        self.assembly, self.meshcat = self._build(policy, show)
        make_folder(self.out)

    def _build(self, policy: "Policy", show: bool) -> tuple["Assembly", object]:
        from pace_drake.diagram import JOINT_LOG, Assembly, make_plant_assembly
        from pace_drake.people import load_people

        people = load_people(self.scenario)
        self.console.print(f"[bold]{self.scenario.name}[/bold]: {people.description}", highlight=False)
        if self.level == "task":
            return Assembly(self.scenario, policy, people=people), None
        logging.getLogger("drake").setLevel(logging.WARNING)  # it announces a port that only --meshcat is about
        from pydrake.geometry import Meshcat, MeshcatParams

        meshcat = Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
        meshcat.SetProperty("/Grid", "visible", False)
        meshcat.SetProperty("/Axes", "visible", False)
        meshcat.SetCameraPose(camera_in_world=[-0.35, -1.7, 0.9], target_in_world=[0.6, 0.05, 0.0])
        if show:
            from pace_drake.evaluate.live_panel import LivePanel

            self.console.print(f"live view: {meshcat.web_url()}")
            self.live = LivePanel(meshcat)
        with self.console.status("planning the robot's motions"):
            assembly = make_plant_assembly(self.scenario, policy, meshcat=meshcat, people=people, logged=JOINT_LOG)
        return assembly, meshcat

    def execute(self) -> None:
        """Runs the episodes and writes everything."""
        import numpy as np
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn

        from pace_drake.evaluate.episode import mean_result, run_episode
        from pace_drake.evaluate.event_log import EventLog
        from pace_drake.evaluate.plant_log import PlantLog
        from pace_drake.evaluate.workcell import WorkcellRecorder
        from pace_drake.files import write_whole
        from pace_drake.simulation import Simulation

        scenario = self.scenario
        write_whole(self.out / "scenario.yaml", lambda part: part.write_text(scenario.to_yaml(), encoding="utf-8"))
        simulation = Simulation(self.assembly)
        results: list[EpisodeResult] = []
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("simulated {task.fields[simulated]:7.1f} s"),
        )
        total = self.episodes if self.episodes > 1 else scenario.task.num_human_actions
        unit = "episodes" if self.episodes > 1 else "human actions"
        with (
            EventLog(self.out / "events.csv") as log,
            Progress(*columns, console=self.console, refresh_per_second=2) as bar,
        ):
            item = bar.add_task(f"{self.level} level, {unit}", total=total, simulated=0.0)
            for number in range(self.episodes):
                recording = number == 0 and self.meshcat is not None
                if recording:
                    seen = self.live is not None
                    self.meshcat.StartRecording(10.0, set_visualizations_while_recording=seen)  # type: ignore[attr-defined]

                def write(time: float, kind: str, episode: int = number, **values) -> None:
                    log.write(episode, time, kind, **values)

                def show(time: float, number: int = number) -> None:
                    action = int(simulation.output("human_action")[0]) - 1
                    bar.update(item, completed=number if self.episodes > 1 else action, simulated=time)
                    if self.live is not None:
                        self.live.show(simulation)

                episode = simulation.sample_episode(np.random.default_rng([self.seed, number]))
                layout, recorder = None, WorkcellRecorder()
                if self.level == "plant":
                    layout = simulation.sample_layout(np.random.default_rng([self.seed, number, 1]))
                results.append(
                    run_episode(
                        simulation,
                        episode,
                        write,
                        progress=show,
                        sample_phase=number == 0,
                        layout=layout,
                        listeners=(recorder,),
                    )
                )
                self.sorts += recorder.sorts
                if recording:
                    self._write_replay()
                    write_whole(self.out / "plant.npz", PlantLog.of(simulation).write)
            bar.update(item, completed=total)
        mean = mean_result(results)
        self._write_summary(results, mean)
        self._draw()
        self._print_table(mean, [result.truncation for result in results if result.truncation is not None])

    def _write_replay(self) -> None:
        from pace_drake.evaluate.replay import About, replay_page
        from pace_drake.evaluate.timeline import read_events
        from pace_drake.files import write_whole

        meshcat = self.meshcat
        meshcat.StopRecording()  # type: ignore[attr-defined]
        meshcat.PublishRecording()  # type: ignore[attr-defined]
        run = f"policy {self.scenario.policy}, {self.level} level, seed {self.seed}"
        if self.episodes > 1:
            run += f", episode 1 of {self.episodes}"
        about = About(self.scenario.name, run, self.assembly.people.description)
        events = read_events(self.out / "events.csv", 0)
        html = replay_page(meshcat.StaticHtml(), events, self.scenario.task, about)  # type: ignore[attr-defined]
        write_whole(self.out / "replay.html", lambda part: part.write_text(html, encoding="utf-8"))

    def _write_summary(self, results: "list[EpisodeResult]", mean: dict) -> None:
        from pace_drake import __version__
        from pace_drake.files import write_whole

        summary = {
            "pace_drake": __version__,
            "scenario": self.scenario.name,
            "people": self.assembly.people.description,
            "policy": self.scenario.policy,
            "level": self.level,
            "seed": self.seed,
            "human_idle_weight": self.scenario.task.human_idle_weight,
            "episodes": [result.to_json() for result in results],
            "mean": mean,
            **({"sorts": self._sorted()} if self.level == "plant" else {}),
        }
        text = json.dumps(summary, indent=1) + "\n"
        write_whole(self.out / "summary.json", lambda part: part.write_text(text, encoding="utf-8"))

    def _sorted(self) -> dict:
        errors = [sort.error for sort in self.sorts]
        good = sum(sort.good for sort in self.sorts)
        return {"number": len(errors), "good": good, "largest_error": max(errors, default=None)}

    def _draw(self) -> None:
        from pace_drake.evaluate.timeline import draw_timeline, read_events
        from pace_drake.files import write_whole

        events = read_events(self.out / "events.csv", 0)
        title = (
            f"{self.scenario.name}, policy {self.scenario.policy}, {self.level} level, seed {self.seed}: "
            f"{self.assembly.people.description}"
        )
        write_whole(
            self.out / "timeline.png",
            lambda part: draw_timeline(events, self.scenario.task, title, part),
        )

    def _print_table(self, mean: dict, truncations: list[str]) -> None:
        task = self.scenario.task
        what = r"idle time \[s]" if self.episodes == 1 else rf"mean idle time over {self.episodes} episodes \[s]"
        self.console.print(idle_table(mean, joint_names(task), f"{what}, policy {self.scenario.policy}"))
        rmse = mean["phase_rmse"]
        self.console.print(
            f"cost (lambda = {task.human_idle_weight:g}): [bold]{mean['cost']:.2f} s[/bold]; "
            f"{mean['decisions']:.1f} decisions; {mean['duration']:.1f} s simulated at a real-time factor of "
            f"{mean['real_time_factor']:.1f}" + (f"; phase error at decisions {rmse:.3f} rms" if rmse else ""),
            highlight=False,
        )
        if self.sorts:
            done = self._sorted()
            self.console.print(
                f"cubes in their trays: {done['good']} of {done['number']}, "
                f"at most {1e3 * done['largest_error']:.1f} mm off the middle",
                highlight=False,
            )
        if truncations:
            why = "; ".join(dict.fromkeys(truncations))
            self.console.print(f"{len(truncations)} of {self.episodes} episodes truncated {why}", highlight=False)
        self.console.print(f"run folder: {self.out}", highlight=False, soft_wrap=True)

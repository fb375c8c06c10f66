"""Playing a policy in the diagram, and holding the compiled twin equal to it."""

from collections.abc import Sequence

import numpy as np

from pace_drake.diagram import Assembly
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.episode import run_episode
from pace_drake.evaluate.play import Played, play
from pace_drake.people import People
from pace_drake.policies import Policy
from pace_drake.scenario import Scenario
from pace_drake.simulation import Simulation
from pace_drake.task import Episode


def play_in_diagram(scenario: Scenario, people: People, policy: Policy, episodes: Sequence[Episode]) -> Played:
    """Plays a policy on episodes, one after the other, at the task level.

    Args:
        scenario: of the policy and the episodes.
        people: of the scenario.
        policy: which.
        episodes: at least one.
    """
    simulation = Simulation(Assembly(scenario, policy, people=people))
    results = [run_episode(simulation, episode) for episode in episodes]
    return Played(
        robot_idle=np.array([one.robot_idle for one in results]),
        human_idle=np.array([one.human_idle for one in results]),
        cost=np.array([one.cost for one in results]),
        time=np.array([one.duration for one in results]),
        decisions=np.array([one.decisions for one in results]).astype(int),
        finished=np.array([one.finished for one in results]),
    )


def check_by_diagram(twin: AssemblyTwin, parts: np.ndarray, policy: Policy, people: People) -> None:
    """Plays a policy on episodes in the twin and in the diagram, and holds both equal.

    Args:
        twin: with as many environments as episodes; what they did before is over.
        parts: (E, N + 3) rows of its pool's ``sample``.
        policy: which.
        people: of the twin's scenario.

    Raises:
        RuntimeError: idle times differ by more than 1e-6 s, or the number of decisions does.
    """
    mine = play(twin, parts, policy)
    theirs = play_in_diagram(twin.scenario, people, policy, [twin.pool.episode(row) for row in parts])
    for name in ("robot_idle", "human_idle", "decisions"):
        in_twin, in_diagram = getattr(mine, name), getattr(theirs, name)
        if not np.allclose(in_twin, in_diagram, rtol=0.0, atol=1e-6):
            raise RuntimeError(f"{name}: {in_twin.tolist()} in the twin, {in_diagram.tolist()} in the diagram")

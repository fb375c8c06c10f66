"""Whether the diagram makes of drawn episodes what the compiled twin makes of them."""

import numpy as np

from pace_drake.diagram import Assembly
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.episode import run_episode
from pace_drake.evaluate.play import play
from pace_drake.people import People
from pace_drake.policies import Policy
from pace_drake.simulation import Simulation


def check_by_diagram(twin: AssemblyTwin, parts: np.ndarray, policy: Policy, people: People) -> None:
    """Plays a policy on episodes in the diagram, and holds their idle times equal to the twin's.

    Args:
        twin: with as many environments as episodes; what they did before is over.
        parts: (E, N + 3) rows of its pool's ``sample``.
        policy: which.
        people: of the twin's scenario.

    Raises:
        RuntimeError: they differ by more than 1e-6 s, or in a decision.
    """
    played = play(twin, parts, policy)
    simulation = Simulation(Assembly(twin.scenario, policy, people=people))
    for k, row in enumerate(parts):
        result = run_episode(simulation, twin.pool.episode(row))
        mine = np.concatenate([played.robot_idle[k], played.human_idle[k]])
        its = np.array([*result.robot_idle, *result.human_idle])
        if not np.allclose(mine, its, rtol=0.0, atol=1e-6) or result.decisions != played.decisions[k]:
            raise RuntimeError(
                f"episode {k}: idle times {its.tolist()} s after {result.decisions} decisions in the diagram,"
                f" {mine.tolist()} s after {played.decisions[k]} in the twin"
            )

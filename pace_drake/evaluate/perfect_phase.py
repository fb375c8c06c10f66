"""Perfect phase: what a policy can reach that knows when the person will be ready, but not how long the robot takes.

Between two joint actions this is optimal stopping over the time w until the person is ready:

    V(w) = min( E[(w - P)+] + lambda E[(P - w)+],  E[V(w - R)],  w > R;  lambda (R - w) + V(0) otherwise )
"""

import numpy as np

from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.play import Played, play_by
from pace_drake.evaluate.timed_optimum import STEP, assistance_cost, on_grid
from pace_drake.scenario import Scenario


def perfect_phase_table(scenario: Scenario, step: float = STEP) -> np.ndarray:
    """(L, n) whether to assist in joint action l when the person will be ready in 0, 1, ... steps.

    Where the robot's tasks differ, the mean of their distributions counts.
    """
    task = scenario.task
    robot = [on_grid(one.duration, step) for one in task.robot_tasks]
    r = np.zeros(max(len(p) for p in robot))
    for p in robot:
        r[: len(p)] += p / len(robot)
    first = 0
    longest = 0.0
    for last in task.human_index_of_joint:
        longest = max(longest, sum(float(a.duration.quantile(1 - 1e-9)) for a in task.human_actions[first : last - 1]))
        first = last
    size = int(longest / step) + 2
    table = np.ones((task.num_joint_actions, size), dtype=bool)
    for joint, assistance in enumerate(task.assistances):
        now = assistance_cost(on_grid(assistance.preparation, step), size, task.human_idle_weight, step)
        value = np.zeros(size)
        n = np.arange(len(r))
        for w in range(size):
            late = task.human_idle_weight * step * np.maximum(n - w, 0)
            after = value[np.maximum(w - n, 0)]
            after[0] = np.inf if r[0] > 0 else 0.0
            go_on = r[1:] @ (late + after)[1:] if w else np.inf
            table[joint, w] = now[w] <= go_on
            value[w] = min(now[w], go_on)
    return table


def play_with_perfect_phase(twin: AssemblyTwin, parts: np.ndarray, step: float = STEP) -> Played:
    """Plays episodes, told at every decision when the person will be ready; arguments as ``evaluate.play``."""
    table = perfect_phase_table(twin.scenario, step)

    def decide(envs: np.ndarray) -> np.ndarray:
        ready = twin.time_until_ready(envs)
        at = np.clip(np.round(ready / step), 0, table.shape[1] - 1).astype(int)
        return (ready == 0) | table[twin.segment(envs), at]

    return play_by(twin, parts, decide)

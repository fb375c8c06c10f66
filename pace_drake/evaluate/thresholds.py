"""The best threshold rules of a scenario, by search over the diagram itself."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pace_drake.diagram import Assembly
from pace_drake.people import load_people
from pace_drake.policies.rules import Threshold, joint_actions
from pace_drake.scenario import Scenario
from pace_drake.simulation import Simulation

#: Candidates: elapsed time relative to the action's mean duration, and phase.
ELAPSED_FRACTIONS = np.round(np.arange(0.05, 1.2501, 0.05), 3)
PHASES = np.round(np.arange(0.15, 1.0001, 0.05), 3)


@dataclass
class _AnyThreshold:
    """A threshold policy whose thresholds change between episodes; for the search alone."""

    rule: Threshold

    def decide(self, observation: np.ndarray) -> int:
        return self.rule.decide(observation)


@dataclass(frozen=True)
class ThresholdSearch:
    """Result of a search.

    Attributes:
        thresholds: per non-joint human action, by name; [s] or [-].
        cost: [s] mean cost of the rule on the episodes it was found on.
        costs: (num candidates, L) [s] mean cost per joint action, for a look at how flat the optimum is.
    """

    thresholds: dict[str, float]
    cost: float
    costs: np.ndarray


def search_thresholds(
    scenario: Scenario,
    element: int,
    num_episodes: int,
    seed: int = 0,
    progress: Callable[[int], None] = lambda _done: None,
) -> ThresholdSearch:
    """Finds the best threshold for each non-joint action, on common random numbers.

    What happens before one joint action depends on the thresholds of its own segment alone (the person's clock starts
    anew after each joint action, and the robot then decides after homing), so all segments are searched at once.

    Args:
        scenario: its people's split is used as it is.
        element: 2 for elapsed time, 3 for phase.
        num_episodes: per candidate.
        seed: of the episodes.
        progress: called with the number of candidates done.
    """
    task = scenario.task
    people = load_people(scenario)
    if element == 2:  # the phase is not looked at: spare the estimator's time
        people = replace(people, references=[None] * task.num_human_actions)
    candidates = ELAPSED_FRACTIONS if element == 2 else PHASES
    scale = np.array([a.duration.mean if element == 2 else 1.0 for a in task.human_actions])
    joint = joint_actions(task)
    policy = _AnyThreshold(Threshold(element, (), joint))
    simulation = Simulation(Assembly(scenario, policy, people=people))
    costs = np.zeros((len(candidates), task.num_joint_actions))
    for k, candidate in enumerate(candidates):
        policy.rule = replace(policy.rule, thresholds=tuple(candidate * scale))
        for episode in range(num_episodes):
            simulation.reset(simulation.sample_episode(np.random.default_rng([seed, episode])))
            simulation.run()
            idle = simulation.output("robot_idle") + task.human_idle_weight * simulation.output("human_idle")
            costs[k] += idle / num_episodes
        progress(k + 1)
    best = candidates[np.argmin(costs, axis=0)]
    thresholds, segment = {}, 0
    for action, unit in zip(task.human_actions, scale, strict=True):
        if action.joint:
            segment += 1
        else:
            thresholds[action.name] = float(round(best[segment] * unit, 3))
    return ThresholdSearch(thresholds, float(costs.min(axis=0).sum()), costs)

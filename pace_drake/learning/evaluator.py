"""Evaluation in the course of training: the best parameters seen, and an end where nothing gets better."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from pace_drake.envs.pool import cached_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.play import play
from pace_drake.evaluate.policies import POOL_SIZE
from pace_drake.learning.greedy import GreedyPolicy
from pace_drake.people import People
from pace_drake.scenario import Scenario

#: Episodes on which an agent in training is played, and the seed of them and their pool: the same in every training.
EPISODES = 1000
EVALUATION_SEED = 10_001
#: What counts as an improvement, as a share of the cost.
IMPROVEMENT = 0.005


class Evaluator(BaseCallback):
    """Plays the greedy policy on fixed episodes every so many decisions, and in the end.

    Args:
        scenario: its own split of people is played.
        people: of the scenario.
        every: decisions from one evaluation to the next; they fall between updates.
        patience: stop after so many evaluations without an improvement of ``IMPROVEMENT``; None: never.
        report: called with (decisions, cost [s]) of each evaluation.
        episodes: how many.

    Attributes:
        history: (decisions, mean cost [s]) of each evaluation.
        best: (decisions, mean cost [s]) of the best; None before the first.

    Raises:
        InputError: the scenario cannot be run by the twin.
    """

    def __init__(
        self,
        scenario: Scenario,
        people: People,
        every: int,
        patience: int | None = None,
        report: Callable[[int, float], None] = lambda _decisions, _cost: None,
        episodes: int = EPISODES,
    ) -> None:
        super().__init__()
        pool = cached_pool(scenario, people, POOL_SIZE, EVALUATION_SEED)
        self._twin = AssemblyTwin(scenario, pool, episodes)
        self._parts = pool.sample(episodes, np.random.default_rng(EVALUATION_SEED))
        self._every, self._patience, self._report = every, patience, report
        self.history: list[tuple[int, float]] = []
        self.best: tuple[int, float] | None = None
        self._best_parameters: dict[str, np.ndarray] = {}
        #: The cost that must be improved upon, evaluations since it was reached, and decisions and updates up to the
        #: last evaluation.
        self._mark, self._stalled, self._seen, self._updates = np.inf, 0, 0, 0

    @property
    def stops(self) -> bool:
        """Whether patience is at its end."""
        return self._patience is not None and self._stalled >= self._patience

    def restore_best(self) -> None:
        """Puts the best parameters into the agent's network."""
        if self._best_parameters:
            found = {name: torch.tensor(value) for name, value in self._best_parameters.items()}
            self.model.policy.load_state_dict(found)

    def snapshot(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """(arrays, plain data) for ``restore``."""
        data = {"history": self.history, "best": self.best, "mark": self._mark, "stalled": self._stalled}
        return dict(self._best_parameters), {**data, "seen": self._seen, "updates": self._updates}

    def restore(self, arrays: Mapping[str, np.ndarray], data: Mapping[str, Any]) -> None:
        """Goes on from a ``snapshot``."""
        self._best_parameters = dict(arrays)
        self.history = [(int(decisions), float(cost)) for decisions, cost in data["history"]]
        self.best = None if data["best"] is None else (int(data["best"][0]), float(data["best"][1]))
        self._mark, self._stalled = float(data["mark"]), int(data["stalled"])
        self._seen, self._updates = int(data["seen"]), int(data["updates"])

    def _on_rollout_start(self) -> None:
        # Between two updates: the network is whole, and nothing of the next rollout has been drawn.
        if self.num_timesteps // self._every > self._seen // self._every:
            self._evaluate()

    def _on_step(self) -> bool:
        return not self.stops

    def _on_training_end(self) -> None:
        if self._num_updates() > self._updates:
            self._evaluate()

    def _num_updates(self) -> int:
        return int(self._agent._n_updates)

    @property
    def _agent(self) -> PPO:
        assert isinstance(self.model, PPO)
        return self.model

    def _evaluate(self) -> None:
        played = play(self._twin, self._parts, GreedyPolicy(self._agent, self._twin.scenario))
        cost = float(played.cost.mean())
        self._seen, self._updates = self.num_timesteps, self._num_updates()
        self.history.append((self.num_timesteps, cost))
        if self.best is None or cost < self.best[1]:
            self.best = (self.num_timesteps, cost)
            state = self.model.policy.state_dict()
            self._best_parameters = {name: value.numpy().copy() for name, value in state.items()}
        if cost < self._mark * (1 - IMPROVEMENT):
            self._mark, self._stalled = cost, 0
        else:
            self._stalled += 1
        self.logger.record("eval/cost", cost)
        self.logger.dump(self.num_timesteps)
        self._report(self.num_timesteps, cost)

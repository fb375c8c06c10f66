"""Where the components lie: drawn once for an episode."""

from dataclasses import dataclass

import numpy as np

from pace_drake.stations.components import components
from pace_drake.stations.workcell import Workcell
from pace_drake.task import NUM_ROBOT_DRAWS


@dataclass(frozen=True)
class Layout:
    """Everything random about where components lie in one episode.

    Attributes:
        located: (n, 3) x [m], y [m], yaw [rad] of each component at the start, in the order of ``components``.
        pile: (NUM_ROBOT_DRAWS, number of cubes, 3) where a cube lies when the pile is refilled with it for the command
            with sequence number s: ``pile[(s - 1) % NUM_ROBOT_DRAWS, cube]``.
    """

    located: np.ndarray
    pile: np.ndarray


def nominal_layout(workcell: Workcell) -> Layout:
    """Everything in the middle of its zone."""
    located = np.array([component.located for component in components(workcell)])
    return Layout(located, np.broadcast_to(located[: len(workcell.cubes)], (NUM_ROBOT_DRAWS, len(workcell.cubes), 3)))


def sample_layout(workcell: Workcell, rng: np.random.Generator) -> Layout:
    """Draws a layout: each component evenly within its spread. The same state of ``rng`` gives the same layout."""
    nominal = nominal_layout(workcell)
    spread = np.array([component.spread for component in components(workcell)])
    return Layout(
        nominal.located + spread * rng.uniform(-1.0, 1.0, nominal.located.shape),
        nominal.pile + spread[: len(workcell.cubes)] * rng.uniform(-1.0, 1.0, nominal.pile.shape),
    )

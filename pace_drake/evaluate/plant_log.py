"""What the plant did at every step of an episode, and whether the arm stayed within its limits."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pace_drake.simulation import Simulation
from pace_drake.stations.plant import NUM_ARM_JOINTS, PlantStation


@dataclass(frozen=True)
class PlantLog:
    """Samples at every step of the plant.

    Attributes:
        time: (n) [s]
        position_desired: (n, 7) [rad]
        position: (n, 7) [rad] measured.
        velocity: (n, 7) [rad/s]
        gripper: (n, 2) [m, m/s] width and its rate.
        contact: (n, 2) largest penetration [m], number of contacts of the robot with itself; None if it was not logged.
        look_time: (k) [s] looks of the safety monitor; None without one, as the following.
        hand_distance: (k) [m] least distance of arm and hand.
        speed_scale: (k) [-] to which the arm was slowed.
    """

    time: np.ndarray
    position_desired: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    gripper: np.ndarray
    contact: np.ndarray | None
    look_time: np.ndarray | None = None
    hand_distance: np.ndarray | None = None
    speed_scale: np.ndarray | None = None

    @classmethod
    def of(cls, simulation: Simulation, *, copy: bool = True) -> "PlantLog":
        """Takes the log of the episode that has been run.

        Args:
            simulation: of an assembly that was logged.
            copy: whether the log outlasts the present instant; without, its samples are the simulation's own, and must
                not be used once that goes on. An episode's are 4 MB.
        """
        logs = {name: sink.FindLog(simulation.context) for name, sink in simulation.assembly.plant_log.items()}
        data = {name: np.array(log.data().T, copy=copy or None) for name, log in logs.items()}
        return cls(
            time=logs["position_desired"].sample_times().copy(),
            position_desired=data["position_desired"],
            position=data["panda.position_measured"],
            velocity=data["panda.velocity_estimated"],
            gripper=data["gripper.state_measured"],
            contact=data.get("contact"),
            look_time=logs["hand_distance"].sample_times().copy() if "hand_distance" in logs else None,
            hand_distance=data["hand_distance"][:, 0] if "hand_distance" in data else None,
            speed_scale=data["speed_scale"][:, 0] if "speed_scale" in data else None,
        )

    def write(self, path: Path) -> None:
        """Writes an .npz file; its arrays have the names of the attributes."""
        arrays = {name: value for name, value in vars(self).items() if value is not None}
        np.savez_compressed(path, **arrays)


@dataclass(frozen=True)
class LimitsKept:
    """How near an episode came to what must not be passed.

    Attributes:
        position: [rad] least distance of a joint from its limits.
        velocity, acceleration: [-] largest share of a joint's limit; accelerations are differences of velocities.
        tracking: [rad] largest difference between desired and measured positions.
        penetration: [m] largest.
        self_contacts: steps at which the robot touched itself.
    """

    position: float
    velocity: float
    acceleration: float
    tracking: float
    penetration: float
    self_contacts: int

    @property
    def kept(self) -> bool:
        """Whether every limit was kept at every step, and the robot did not touch itself."""
        return self.position >= 0 and self.velocity <= 1 and self.acceleration <= 1 and self.self_contacts == 0


def check_limits(log: PlantLog, station: PlantStation) -> LimitsKept:
    """Compares a log, contacts included, with the arm's limits in its model."""
    assert log.contact is not None
    plant = station.plant
    joints = [plant.GetJointByName(f"panda_joint{k + 1}") for k in range(NUM_ARM_JOINTS)]
    lower = np.array([joint.position_lower_limit() for joint in joints])
    upper = np.array([joint.position_upper_limit() for joint in joints])
    velocity = np.array([joint.velocity_upper_limit() for joint in joints])
    acceleration = np.array([joint.acceleration_upper_limit() for joint in joints])
    step = station.workcell.time_step

    def largest(share: Callable[[int], np.ndarray]) -> float:
        # Joint by joint: what is worked out for all seven at once takes a multiple of the log's memory.
        return max(float(np.max(share(k))) for k in range(NUM_ARM_JOINTS))

    q, v = log.position.T, log.velocity.T
    return LimitsKept(
        position=-largest(lambda k: np.maximum(lower[k] - q[k], q[k] - upper[k])),
        velocity=largest(lambda k: np.abs(v[k]) / velocity[k]),
        acceleration=largest(lambda k: np.abs(np.diff(v[k])) / step / acceleration[k]),
        tracking=largest(lambda k: np.abs(q[k] - log.position_desired[:, k])),
        penetration=float(np.max(log.contact[:, 0])),
        self_contacts=int(np.count_nonzero(log.contact[:, 1])),
    )

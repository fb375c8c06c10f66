"""What the arm does for every robot action: joint trajectories planned once, replayed at any slower speed.

A motion is a chain of legs (``pace_drake.stations.legs``) that start and end at rest, with pauses in which the gripper
opens or closes. Things are held by friction alone: the desired width of the closed gripper is less than theirs.
Robot tasks and preparations fetch something and so depend on where it lies; all the rest is the same every time.
"""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from importlib.metadata import version
from math import atan2
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import RigidTransform
from scipy.interpolate import CubicHermiteSpline, PPoly

from pace_drake.errors import InputError
from pace_drake.files import cache_folder, write_whole
from pace_drake.resources import resource_path
from pace_drake.stations.components import (
    TRAY_FLOOR,
    Component,
    closed_width,
    component_index,
    components,
    presentation_index,
    tray_index,
)
from pace_drake.stations.joint_paths import CARRY_BEGIN, CARRY_END, OFFERED
from pace_drake.stations.legs import Leg, LegPlanner, Load, Via
from pace_drake.stations.planning_scene import PLACED_SIDE, PlanningScene
from pace_drake.stations.plant import NUM_ARM_JOINTS
from pace_drake.stations.workcell import Workcell
from pace_drake.task import ActionKind

_FETCHING = frozenset((ActionKind.ROBOT_TASK, ActionKind.PREPARE))
_NUM_KEPT = 16  # located motions in memory
_PLANS = 2  # version of what is written to the cache


@dataclass(frozen=True)
class HandOver:
    """When and how the gripper lets go of what the person takes from it."""

    offered: float
    """[-] share of the motion after which the thing is held out."""
    p_WH: np.ndarray
    """(3) [m] where the hand takes it."""
    reach: float
    """[m] within which of that place the hand has it."""
    speed: float
    """[m/s] at which the gripper opens."""
    width: float
    """[m] to which it opens."""


@dataclass(frozen=True)
class Motion:
    """A joint trajectory and the gripper's width along it, at the least duration."""

    times: np.ndarray
    """(n) [s] knots of a cubic Hermite spline, from 0."""
    positions: np.ndarray
    """(n, 7) [rad]"""
    velocities: np.ndarray
    """(n, 7) [rad/s]"""
    width_times: np.ndarray
    """(m) [s]"""
    widths: np.ndarray
    """(m) [m] desired, linear in between."""
    approaches: np.ndarray = field(default_factory=lambda: np.zeros((0, NUM_ARM_JOINTS)))
    """(k, 7) [rad] postures over what is fetched, from which a motion for another place is sought."""

    hand_over: HandOver | None = None
    """How what is held out is let go; None where the gripper opens by the clock."""

    @cached_property
    def duration(self) -> float:
        """[s]"""
        return float(self.times[-1])

    @cached_property
    def _spline(self) -> CubicHermiteSpline:
        """(7) [rad] over [0, duration]; a tenth of the memory of Drake's PiecewisePolynomial."""
        return CubicHermiteSpline(self.times, self.positions, self.velocities)

    @cached_property
    def _rate(self) -> PPoly:
        """(7) [rad/s] over [0, duration]."""
        return self._spline.derivative()

    def position(self, fraction: float) -> np.ndarray:
        """Returns the (7) joint positions [rad] at a fraction of the motion, clamped to [0, 1].

        The time-optimal trajectory is scaled linearly in time: replayed in ``k`` times its duration, it has 1/k of its
        velocities and 1/k^2 of its accelerations.
        """
        return self._spline(min(max(fraction, 0.0), 1.0) * self.duration)

    def path_positions(self, fractions: np.ndarray) -> np.ndarray:
        """Returns the (n, 7) joint positions [rad] at fractions (n) of the motion, clamped to [0, 1]."""
        return self._spline(np.clip(fractions, 0.0, 1.0) * self.duration)

    def path_velocities(self, fractions: np.ndarray) -> np.ndarray:
        """Returns the (n, 7) joint velocities [rad/s] at fractions (n) of the motion at full speed; 0 beyond it."""
        inside = (fractions >= 0.0) & (fractions <= 1.0)
        return self._rate(np.clip(fractions, 0.0, 1.0) * self.duration) * inside[:, None]

    def gripper_width(self, fraction: float) -> float:
        """Returns the desired width [m] between the fingers at a fraction of the motion, clamped to [0, 1]."""
        return float(np.interp(min(max(fraction, 0.0), 1.0) * self.duration, self.width_times, self.widths))


class MotionLibrary:
    """Planned motions of all robot actions, by kind and 1-based index.

    ROBOT_TASK i starts and ends at ``home``; PREPARE l leads from ``home`` to the prepared position of joint action l;
    JOINT l from there to its end; HOME l from that end, and HOME_ABORTED l from the prepared position (it takes the
    component back), to ``home``. Gripper widths join up in the same way.

    ROBOT_TASK and PREPARE take ``located`` (3): x [m], y [m], yaw [rad] of the component that they fetch; None is its
    nominal place. A motion for another place is planned when first asked for, and is a function of the place alone.

    Iterating yields the (kind, index) of every motion. Looking up another one raises KeyError.

    Args:
        workcell: where things stand.
        motions: the nominal ones.
    """

    def __init__(self, workcell: Workcell, motions: dict[tuple[ActionKind, int], Motion]) -> None:
        self.home = np.array(workcell.home, dtype=float)
        """(7) [rad] home position."""
        self._workcell = workcell
        self._motions = motions
        self._located: OrderedDict[tuple[ActionKind, int, bytes], Motion] = OrderedDict()

    @cached_property
    def _planner(self) -> "_Planner":
        return _Planner(self._workcell)

    def component(self, kind: ActionKind, index: int) -> int | None:
        """Which component, as an index into ``components``, the action fetches; None if it fetches none."""
        return component_index(self._workcell, kind, index)

    def motion(self, kind: ActionKind, index: int, located: np.ndarray | None = None) -> Motion:
        """The motion of an action; see the class.

        Raises:
            InputError: the component cannot be fetched from there.
        """
        nominal = self._motions[kind, index]
        if located is None or kind not in _FETCHING:
            return nominal
        key = (kind, index, located.tobytes())
        motion = self._located.get(key)
        if motion is None:
            fetched = self.component(kind, index)
            assert fetched is not None
            same = np.array_equal(located, components(self._workcell)[fetched].located)
            motion = nominal if same else self._planner.fetch(kind, index, located, nominal)
            self._located[key] = motion
            if len(self._located) > _NUM_KEPT:
                self._located.popitem(last=False)
        return motion

    def position(self, kind: ActionKind, index: int, fraction: float) -> np.ndarray:
        """``Motion.position`` of a nominal motion."""
        return self._motions[kind, index].position(fraction)

    def gripper_width(self, kind: ActionKind, index: int, fraction: float) -> float:
        """``Motion.gripper_width`` of a nominal motion."""
        return self._motions[kind, index].gripper_width(fraction)

    def minimum_duration(self, kind: ActionKind, index: int) -> float:
        """[s] that a nominal motion takes at full speed, gripper included."""
        return self._motions[kind, index].duration

    def __iter__(self) -> Iterator[tuple[ActionKind, int]]:
        return iter(self._motions)

    def __len__(self) -> int:
        return len(self._motions)


def plan_motions(workcell: Workcell, num_robot_tasks: int, num_joint_actions: int) -> MotionLibrary:
    """Plans the motions of all robot actions. The same arguments give the same library.

    The user's cache keeps them by the hash of all that they depend on.

    Args:
        workcell: where things stand, limits, clearance.
        num_robot_tasks: M. Robot task i takes cube i to tray i, cyclically.
        num_joint_actions: L. Joint action 1 handles the chair's side, the others Allen keys, cyclically.

    Raises:
        InputError: the workcell cannot be used, a place is out of reach, or a motion comes nearer to something than
            ``workcell.clearance``.
    """
    workcell.validate()
    for name, number in (("num_robot_tasks", num_robot_tasks), ("num_joint_actions", num_joint_actions)):
        if number < 0:
            raise InputError(f"{name}: must be >= 0, is {number}")
    path = cache_folder("motions") / f"motions_{_key(workcell, num_robot_tasks, num_joint_actions)[:24]}.npz"
    kinds = (ActionKind.PREPARE, ActionKind.JOINT, ActionKind.HOME, ActionKind.HOME_ABORTED)
    actions = [(ActionKind.ROBOT_TASK, i + 1) for i in range(num_robot_tasks)]
    actions += [(kind, index + 1) for index in range(num_joint_actions) for kind in kinds]
    motions = _read(path, actions)
    if motions is None:
        planner = _Planner(workcell)
        motions = {action: planner.plan(*action) for action in actions}
        write_whole(path, lambda part: _write(part, motions))
    return MotionLibrary(workcell, motions)


def _key(workcell: Workcell, *numbers: int) -> str:
    """Hash of everything that motions depend on: the workcell, the models, Drake, and the code that plans."""
    digest = sha256(f"{_PLANS} {version('drake')} {numbers}\n".encode())
    digest.update(yaml_dump_typed(workcell, schema=Workcell).encode())
    folder = resource_path("models/package.xml").parent
    sources = [Path(__file__).with_name(f"{name}.py") for name in ("motions", "legs", "planning_scene", "components")]
    for path in [*sorted(p for p in folder.iterdir() if p.suffix in (".urdf", ".sdf", ".yaml")), *sources]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


_ARRAYS = ("times", "positions", "velocities", "width_times", "widths", "approaches")


def _write(path: Path, motions: dict[tuple[ActionKind, int], Motion]) -> None:
    arrays = {
        f"{kind}_{index}_{name}": getattr(motion, name) for (kind, index), motion in motions.items() for name in _ARRAYS
    }
    for (kind, index), motion in motions.items():
        if motion.hand_over is not None:
            h = motion.hand_over
            arrays[f"{kind}_{index}_hand_over"] = np.array([h.offered, *h.p_WH, h.reach, h.speed, h.width])
    np.savez(path, **arrays)


def _read(path: Path, actions: Sequence[tuple[ActionKind, int]]) -> dict[tuple[ActionKind, int], Motion] | None:
    """Motions from the cache; None if they are not there, or the file is damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            motions = {}
            for kind, index in actions:
                arrays = {name: file[f"{kind}_{index}_{name}"] for name in _ARRAYS}
                hand_over = None
                if f"{kind}_{index}_hand_over" in file:
                    offered, x, y, z, reach, speed, width = file[f"{kind}_{index}_hand_over"].tolist()
                    hand_over = HandOver(offered, np.array([x, y, z]), reach, speed, width)
                motions[kind, index] = Motion(**arrays, hand_over=hand_over)
            return motions
    except (OSError, KeyError, ValueError, EOFError, BadZipFile):
        return None


class _Planner:
    """What the actions are made of."""

    def __init__(self, workcell: Workcell) -> None:
        self.workcell = workcell
        self.scene = PlanningScene(workcell)
        self.legs = LegPlanner(self.scene)
        self.components = components(workcell)
        home = np.array(workcell.home, dtype=float)
        self.home = Via("home", home, self.scene.gripper_pose(home))
        self._prepared_vias: dict[int, Via] = {}

    def plan(self, kind: ActionKind, index: int) -> Motion:
        """The motion of an action, for its component's nominal place."""
        if kind in _FETCHING:
            return self.fetch(kind, index, None, None)
        of_side = {ActionKind.JOINT: self._carry_side, ActionKind.HOME: self._leave_side}
        of_key = {ActionKind.JOINT: self._offer_key, ActionKind.HOME: self._leave_person}
        if kind == ActionKind.HOME_ABORTED:
            return self._take_back(index)
        return of_side[kind]() if index == 1 else of_key[kind](index)

    def fetch(self, kind: ActionKind, index: int, located: np.ndarray | None, nominal: Motion | None) -> Motion:
        """ROBOT_TASK or PREPARE with the component at ``located``, sought near the nominal motion's postures."""
        number = component_index(self.workcell, kind, index)
        assert number is not None
        component = self.components[number]
        near = None if nominal is None else nominal.approaches
        if kind == ActionKind.ROBOT_TASK:
            return self._sort(index, component, located, near)
        return self._prepare(index, component, located, near)

    # ---- robot tasks

    def _sort(self, i: int, cube: Component, located: np.ndarray | None, near: np.ndarray | None) -> Motion:
        w = self.workcell
        tray = tray_index(w, i)
        over, at = self._pick(cube, located, near)
        X_WTray = w.trays[tray].to_rigid_transform()
        p_TrayO = [0.0, 0.0, TRAY_FLOOR + cube.nominal.translation[2] + w.release_gap]
        # Of the four equal yaws over the tray, that which turns the wrist least.
        places = [X_WTray @ RigidTransform(p_TrayO) @ cube.grasp.X_OG(yaw) for yaw in cube.grasp.yaws]
        name, floor = f"tray_{tray + 1}", f"floor of tray_{tray + 1}"
        carried = Load(cube.model, (floor,), (cube.name, name), w.gripper_release)
        let_go = Load("", (name,), (cube.name,), w.gripper_release)
        if near is None:
            over_tray, at_tray = self._approach(f"trays[{tray}]", places, carried, None)
        else:  # the tray is where it was
            over_tray, at_tray = (Via(f"trays[{tray}]", q, self.scene.gripper_pose(q)) for q in near[1:])
        chain = _Chain(self, f"robot task {i}", self.home.q, w.gripper_open)
        chain.move([self.home, over, at], Load("", (cube.name,), (), w.gripper_open), arrive=True)
        chain.grip(closed_width(self.workcell, cube))
        chain.move([at, over, over_tray, at_tray], carried, leave=True, arrive=True)
        chain.grip(w.gripper_release)
        chain.move([at_tray, over_tray, self.home], let_go, leave=True)
        chain.grip(w.gripper_open, during=True)
        return chain.finish(approaches=[over.q, over_tray.q, at_tray.q])

    # ---- joint actions

    def _prepare(self, index: int, component: Component, located: np.ndarray | None, near: np.ndarray | None) -> Motion:
        w = self.workcell
        over, at = self._pick(component, located, near)
        load = Load(component.model, (component.name,), (component.name,), w.gripper_release)
        prepared = self._prepared(index)
        chain = _Chain(self, f"preparation {index}", self.home.q, w.gripper_open)
        chain.move([self.home, over, at], Load("", (component.name,), (), w.gripper_open), arrive=True)
        chain.grip(closed_width(self.workcell, component))
        chain.move([at, over, *self._carried(index, over), prepared], load, leave=True)
        return chain.finish(approaches=[over.q])

    def _carry_side(self) -> Motion:
        w = self.workcell
        side = self._component(1)
        load = Load(side.model, ("chair_base", PLACED_SIDE), (side.name, PLACED_SIDE), w.gripper_release)
        over, at = self._placed(load)
        prepared = self._prepared(1)
        chain = _Chain(self, "joint action 1", prepared.q, closed_width(self.workcell, side))
        leg = self.legs.plan("joint action 1", [prepared, over, at], load, arrive=True)
        let_go = Load("", (), ("chair_base", PLACED_SIDE), w.gripper_release)
        away = self.legs.plan("joint action 1", [at, over], let_go)
        # Carrying takes its share of the time; the person comes before it and goes after it. By then the robot is out
        # of the way: the person's next action may begin where it let go.
        unit = max(
            leg.times[-1] / (CARRY_END - CARRY_BEGIN),
            (chain.grip_time(w.gripper_release) + away.times[-1]) / (1 - CARRY_END),
        )
        chain.wait(CARRY_BEGIN * unit)
        chain.follow(leg.lasting((CARRY_END - CARRY_BEGIN) * unit))
        waited = chain.grip(w.gripper_release)
        chain.follow(away.lasting((1 - CARRY_END) * unit - waited))
        return chain.finish()

    def _leave_side(self) -> Motion:
        w = self.workcell
        over, _ = self._placed(Load("", ("chair_base", PLACED_SIDE), (), w.gripper_release))
        chain = _Chain(self, "homing 1", over.q, w.gripper_release)
        chain.move([over, self.home], Load("", (), (), w.gripper_release))
        chain.grip(w.gripper_open, during=True)
        return chain.finish()

    def _offer_key(self, index: int) -> Motion:
        w = self.workcell
        prepared, end, key = self._prepared(index), self._end(index), self._component(index)
        load = Load(key.model, (), (key.name,), w.gripper_release)
        chain = _Chain(self, f"joint action {index}", prepared.q, closed_width(self.workcell, key))
        leg = self.legs.plan(f"joint action {index}", [prepared, end], load)
        chain.follow(leg)
        chain.wait(leg.times[-1] * (1 / OFFERED - 1))
        return chain.finish(
            hand_over=HandOver(
                offered=OFFERED,
                p_WH=np.array(w.presentations[presentation_index(self.workcell, index)].hand),
                reach=w.release_distance,
                speed=w.gripper_speed,
                width=w.gripper_open,
            )
        )

    def _leave_person(self, index: int) -> Motion:
        w = self.workcell
        end = self._end(index)
        chain = _Chain(self, f"homing {index}", end.q, w.gripper_open)
        chain.move([end, self._prepared(index), self.home], Load("", (), (), w.gripper_open))
        return chain.finish()

    def _take_back(self, index: int) -> Motion:
        """From the prepared position to where the component nominally lies, and home."""
        w = self.workcell
        component = self._component(index)
        over, at = self._pick(component, None, None, gap=w.release_gap)
        carried = Load(component.model, (component.name,), (component.name,), w.gripper_release)
        prepared = self._prepared(index)
        chain = _Chain(self, f"aborted homing {index}", prepared.q, closed_width(self.workcell, component))
        chain.move([prepared, *self._carried(index, over), over, at], carried, arrive=True)
        chain.grip(w.gripper_release)
        chain.move([at, over, self.home], Load("", (component.name,), (), w.gripper_release), leave=True)
        chain.grip(w.gripper_open, during=True)
        return chain.finish()

    # ---- postures

    def _component(self, index: int) -> Component:
        number = component_index(self.workcell, ActionKind.PREPARE, index)
        assert number is not None
        return self.components[number]

    def _prepared(self, index: int) -> Via:
        """Where the robot waits with the component of joint action ``index``; sought once."""
        if index not in self._prepared_vias:
            self._prepared_vias[index] = self._seek_prepared(index)
        return self._prepared_vias[index]

    def _seek_prepared(self, index: int) -> Via:
        component = self._component(index)
        load = Load(component.model, (), (component.name,), self.workcell.gripper_release)
        if index == 1:
            X_WG = self.workcell.chair_side_prepared.to_rigid_transform() @ component.grasp.X_OG(
                component.grasp.yaws[0]
            )
            return self._via("chair_side_prepared", [X_WG], load, self._turned(X_WG))
        k = presentation_index(self.workcell, index)
        X_WG = self.workcell.presentations[k].prepared.to_rigid_transform()
        return self._via(f"presentations[{k}].prepared", [X_WG], load, self._turned(X_WG))

    def _end(self, index: int) -> Via:
        """Where it holds the key out."""
        k = presentation_index(self.workcell, index)
        X_WG = self.workcell.presentations[k].end.to_rigid_transform()
        component = self._component(index)
        load = Load(component.model, (), (component.name,), self.workcell.gripper_release)
        return self._via(f"presentations[{k}].end", [X_WG], load, self._prepared(index).q)

    def _placed(self, load: Load) -> tuple[Via, Via]:
        """Over the chair, and where the side lies on it."""
        side = self._component(1)
        lift = RigidTransform([0.0, 0.0, self.workcell.release_gap])
        X_WG = lift @ self.workcell.chair_side_placed.to_rigid_transform() @ side.grasp.X_OG(side.grasp.yaws[0])
        return self._approach("chair_side_placed", [X_WG], load, self._prepared(1).q)

    def _carried(self, index: int, over: Via) -> list[Via]:
        """How the chair's side gets to the height at which it is carried; nothing for others."""
        if index != 1:
            return []
        p_WG = over.X_WG.translation().copy()
        p_WG[2] = max(p_WG[2], self.workcell.carry_height)
        load = Load("", (), (self._component(1).name,), self.workcell.gripper_release)
        return [self._via("chair_side", [RigidTransform(over.X_WG.rotation(), p_WG)], load, over.q)]

    def _pick(
        self, component: Component, located: np.ndarray | None, near: np.ndarray | None, gap: float = 0.0
    ) -> tuple[Via, Via]:
        """Over a component, and where the gripper takes it (or, ``gap`` [m] higher, puts it down)."""
        X_WO = component.pose(component.located if located is None else located)
        lift = RigidTransform([0.0, 0.0, gap])
        candidates = [lift @ X_WO @ component.grasp.X_OG(yaw) for yaw in component.grasp.yaws]
        load = Load("", (component.name,), (), self.workcell.gripper_open)
        return self._approach(component.name, candidates, load, None if near is None else near[0])

    def _approach(
        self, name: str, candidates: Sequence[RigidTransform], load: Load, near: np.ndarray | None
    ) -> tuple[Via, Via]:
        """Vias over a place and at it, in whichever of the equal yaws suits the arm best."""
        lift = RigidTransform([0.0, 0.0, self.workcell.approach_height])
        lifted = [lift @ X_WG for X_WG in candidates]
        if near is None:
            start = self._turned(lifted[0])
        else:
            start, R_WG = near, self.scene.gripper_pose(near).rotation()
            lifted = [min(lifted, key=lambda X_WG: R_WG.InvertAndCompose(X_WG.rotation()).ToAngleAxis().angle())]
        left, kept = list(lifted), 1.1 * self.workcell.contact_clearance
        while True:
            over = self._via(name, left, load, start)
            try:
                return over, self._via(name, [lift.inverse() @ over.X_WG], load, over.q, clearance=kept, restarts=8)
            except InputError:
                # Down there this yaw does not fit; perhaps another does.
                left = [X_WG for X_WG in left if X_WG is not over.X_WG]
                if not left:
                    raise

    def _turned(self, X_WG: RigidTransform) -> np.ndarray:
        """(7) [rad] the home posture turned towards a place."""
        q = self.home.q.copy()
        x, y, _ = X_WG.translation()
        q[0] = np.clip(q[0] + atan2(y, x), self.scene.lower[0], self.scene.upper[0])
        return q

    def _via(
        self,
        name: str,
        candidates: Sequence[RigidTransform],
        load: Load,
        near: np.ndarray,
        clearance: float | None = None,
        restarts: int = 30,
    ) -> Via:
        rng = np.random.default_rng([self.workcell.seed, *name.encode()])
        kept = 1.1 * self.workcell.clearance if clearance is None else clearance
        return self.legs.via(name, candidates, rng, near, load, kept, restarts)


class _Chain:
    """A motion under construction: legs and gripper pauses, one after the other."""

    def __init__(self, planner: _Planner, name: str, start: np.ndarray, width: float) -> None:
        self._planner = planner
        self._name = name
        self._times = [np.zeros(1)]
        self._positions = [start[None]]
        self._velocities = [np.zeros((1, NUM_ARM_JOINTS))]
        self._width_times, self._widths = [0.0], [width]
        self._begin = 0.0  # [s] of the last leg

    @property
    def _now(self) -> float:
        return float(self._times[-1][-1])

    def move(self, vias: Sequence[Via], load: Load, *, leave: bool = False, arrive: bool = False) -> None:
        """Plans a leg through the vias, from where the chain is, and follows it."""
        self.follow(self._planner.legs.plan(self._name, vias, load, leave=leave, arrive=arrive))

    def follow(self, leg: Leg) -> None:
        """Follows a leg, from where the chain is."""
        self._begin = self._now
        self._append(leg.times[1:] + self._now, leg.positions[1:], leg.velocities[1:])

    def wait(self, duration: float) -> None:
        """Rests [s]; not at all for less than nothing."""
        if duration > 0:
            self._append(np.array([self._now + duration]), self._positions[-1][-1:], np.zeros((1, NUM_ARM_JOINTS)))

    def _change(self, width: float) -> float:
        """[s] in which the gripper comes to the width [m]."""
        return abs(width - self._widths[-1]) / self._planner.workcell.gripper_speed

    def grip_time(self, width: float) -> float:
        """[s] that ``grip`` would wait."""
        return self._change(width) + self._planner.workcell.grip_time

    def grip(self, width: float, *, during: bool = False) -> float:
        """Changes the gripper's width [m] and waits for it; ``during``: instead in the second half of the last leg.

        Returns:
            [s] that the arm waited.
        """
        change = self._change(width)
        if during:
            begin, waited = (self._begin + self._now) / 2, 0.0
            change = min(change, self._now - begin)
        else:
            begin, waited = self._now, self.grip_time(width)
            self.wait(waited)
        self._width_times += [begin, begin + change]
        self._widths += [self._widths[-1], width]
        return waited

    def _append(self, times: np.ndarray, positions: np.ndarray, velocities: np.ndarray) -> None:
        self._times.append(times)
        self._positions.append(positions)
        self._velocities.append(velocities)

    def finish(self, *, hand_over: HandOver | None = None, approaches: Sequence[np.ndarray] = ()) -> Motion:
        """The motion."""
        return Motion(
            np.concatenate(self._times),
            np.concatenate(self._positions),
            np.concatenate(self._velocities),
            np.array(self._width_times),
            np.array(self._widths),
            np.array(approaches).reshape(-1, NUM_ARM_JOINTS),
            hand_over,
        )

"""Synthetic demonstrations of the three non-joint actions of the chair task (Sec. V-B of the paper).

SYNTHETIC: no person was recorded. The numbers below are plausible, not measured; every demonstration made
here says ``synthetic=True``.

The model. An action is a script of motor primitives between places on the assembly table:

- stroke: a minimum-jerk reach (Flash and Hogan 1985), s(u) = 10 u^3 - 15 u^4 + 6 u^5 with u = (t / T)^skew,
  along a path that rises and bends sideways by a fraction of its length;
- twiddle: small circling at 1.5 to 3 Hz, as when a screw or a rail finds its hole;
- press: a push along one direction, there and back;
- turn: the working stroke of an Allen key, an arc about the screw, and the regrasp stroke back, lifted;
- pause: the hand at rest.

place_rails fetches and inserts 4 rails; place_screws straightens the chair's sides, then fetches and inserts
3 screws; tighten_screws seats the key and turns it, for 2 screws.

A subject has a style, drawn once: tempo as a whole and per kind of primitive, speed profile, height and bend
of strokes, places shifted by centimetres, amplitude of small motions, habit of pausing, turns per screw. A
trial draws its own tempo, the duration of every single primitive (log-normal), centimetre scatter of every
target, pauses, second attempts at an insertion, and a turn more or less. So no trial is a warped copy of
another, the reference included: each is played primitive by primitive, then sampled, with slow hand
unsteadiness (physiological tremor, 8-12 Hz, lies above the Nyquist frequency of 10 Hz sampling and arrives as
noise) and sensor noise.

The reference of an action is one more trial, of the subject whose durations have the median mean.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from pace_drake.demos.model import Demonstration, DemonstrationSet
from pace_drake.errors import InputError

# Between subjects: standard deviations of log-normal factors, or of normal ones with a unit.
_SUBJECT_TEMPO = 0.15  # whole action
_SUBJECT_KIND_TEMPO = 0.10  # each kind of primitive
_SUBJECT_SKEW = 0.12  # exponent of the speed profile; above 1 the peak comes late
_SUBJECT_AMPLITUDE = 0.20  # small motions, and turns
_SUBJECT_PLACE = 0.04  # [m] each place, each axis (height: half)
_SUBJECT_TURNS = 1.0  # turns per screw

# Between trials of a subject, and within a trial.
_TRIAL_TEMPO = 0.07  # whole action
_TRIAL_PLACE = 0.02  # [m] each place, each axis (height: half): parts are laid out anew
_PRIMITIVE_TEMPO = 0.25  # each primitive
_TARGET_SCATTER = 0.012  # [m] each target, each axis
_SECOND_ATTEMPT = 0.15  # probability that an insertion is done again

# The hand and its sensor.
_UNSTEADINESS = 0.0015  # [m] standard deviation, each axis
_UNSTEADINESS_TIME = 0.25  # [s] correlation time
_SENSOR_OFFSET = 0.02  # [m] standard deviation per trial, each axis (height: half): inertial capture drifts
_SENSOR_NOISE = 0.001  # [m] standard deviation, each axis, white

_STEP = 0.01  # [s] at which primitives are played; sample periods are multiples of it
_KINDS = ("stroke", "twiddle", "press", "turn")

# Places on the assembly table [m] in W. The person stands at x = 1.35 and faces -x: their right is +y.
_PLACES = {
    "rest": (0.97, 0.12, 0.09),
    "rails": (0.90, 0.28, 0.08),
    "screws": (0.94, 0.22, 0.08),
    "holes": (0.82, 0.00, 0.13),  # middle of the chair's side, to which the offsets below are added
}
_RAIL_HOLES = ((0.09, -0.18, 0.0), (0.03, -0.05, 0.0), (-0.03, 0.07, 0.0), (-0.09, 0.19, 0.0))  # [m]
_SCREW_HOLES = ((0.08, -0.17, 0.10), (0.0, 0.02, 0.10), (-0.08, 0.18, 0.10))  # [m]
_WORKSPACE = np.array([(0.70, 1.00), (-0.31, 0.31), (0.07, 0.28)])  # [m] x, y, z range of targets


@dataclass(frozen=True)
class _Style:
    """What a subject keeps over all trials."""

    tempo: float  # factor on durations
    kind_tempo: dict[str, float]  # factor on durations of each kind of primitive
    skew: float  # exponent of the speed profile
    lift: float  # height of a stroke / its length
    bend: float  # sideways bow of a stroke / its length
    amplitude: float  # factor on small motions and turns
    twiddle_rate: float  # [Hz]
    turn_angle: float  # [rad] arc of one working stroke
    turn_start: float  # [rad] direction of the key at the start of a working stroke
    num_turns: float  # turns per screw; trials round it after adding their own
    pause_probability: float  # before each stroke
    pause_duration: float  # [s] mean
    places: dict[str, NDArray]  # [m] p_WP of each place


class _Hand:
    """Plays primitives one after the other and keeps the path at every step of 10 ms."""

    def __init__(self, style: _Style, rng: np.random.Generator) -> None:
        self._style = style
        self._rng = rng
        self._tempo = style.tempo * rng.lognormal(0.0, _TRIAL_TEMPO)
        self._places = {
            name: place + rng.normal(0.0, _TRIAL_PLACE, 3) * (1.0, 1.0, 0.5) for name, place in style.places.items()
        }
        self._position = self.place("rest")
        self._pieces = [self._position[np.newaxis]]
        self.num_turns = max(4, round(style.num_turns + rng.normal(0.0, 0.5)))

    @property
    def path(self) -> NDArray:
        """All positions so far (num_steps + 1, 3) [m]."""
        return np.concatenate(self._pieces)

    def place(self, name: str, offset: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray:
        """Returns a target near a place (3,) [m], scattered anew at each call."""
        target = self._places[name] + np.asarray(offset) + self._rng.normal(0.0, _TARGET_SCATTER, 3)
        return np.clip(target, *_WORKSPACE.T)

    def stroke(self, target: NDArray, duration: float) -> None:
        """Moves to a target, perhaps after a pause."""
        style = self._style
        if self._rng.random() < style.pause_probability:
            self._hold(self._rng.exponential(style.pause_duration))
        start, way = self._position, target - self._position
        length = float(np.linalg.norm(way))
        across = np.array([-way[1], way[0], 0.0])
        lift = style.lift * length * self._rng.lognormal(0.0, 0.2)
        bend = style.bend + self._rng.normal(0.0, 0.03)
        s = _minimum_jerk(self._steps("stroke", duration) ** style.skew)
        bow = 4.0 * s * (1.0 - s)
        self._append(start + np.outer(s, way) + np.outer(bow, bend * across + (0.0, 0.0, lift)))

    def twiddle(self, duration: float, radius: float) -> None:
        """Circles with a small radius [m] about the position, and ends where it started."""
        u = self._steps("twiddle", duration)
        turns = max(1, round(self._style.twiddle_rate * u.size * _STEP))
        angle = 2.0 * math.pi * turns * u + self._rng.uniform(0.0, 2.0 * math.pi)
        size = radius * self._style.amplitude * np.sin(math.pi * u)
        circle = np.stack([np.cos(angle), np.sin(angle), 0.5 * np.sin(angle + 1.0)], axis=1)
        self._append(self._position + size[:, np.newaxis] * circle)

    def press(self, direction: ArrayLike, duration: float) -> None:
        """Pushes along a vector [m] and comes back."""
        u = self._steps("press", duration)
        push = np.asarray(direction) * self._style.amplitude * self._rng.lognormal(0.0, 0.15)
        self._append(self._position + np.outer(np.sin(math.pi * u) ** 2, push))

    def turn(self, screw: NDArray, radius: float, duration: float) -> None:
        """Turns an Allen key of a length [m] about a screw, then takes it back to where the turn began."""
        style, rng = self._style, self._rng
        begin = style.turn_start + rng.normal(0.0, 0.08)
        end = begin + style.turn_angle * rng.lognormal(0.0, 0.10)
        radius *= style.amplitude
        work = _minimum_jerk(self._steps("turn", 0.6 * duration) ** style.skew)
        back = _minimum_jerk(self._steps("turn", 0.4 * duration))
        angle = np.concatenate([begin + (end - begin) * work, end + (begin - end) * back])
        height = np.concatenate([np.zeros_like(work), 0.03 * style.amplitude * 4.0 * back * (1.0 - back)])
        circle = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
        # The blend takes out the jump to where the previous primitive left the hand.
        gap = self._position - (screw + circle[0])
        self._append(screw + circle + np.outer(1.0 - np.concatenate([work, np.ones_like(back)]), gap))

    def insert(self, duration: float, radius: float, press: ArrayLike) -> None:
        """Twiddles and presses, and again where the first attempt fails."""
        self.twiddle(duration, radius)
        self.press(press, 0.6)
        if self._rng.random() < _SECOND_ATTEMPT:
            self.twiddle(0.6 * duration, radius)
            self.press(press, 0.6)

    def _hold(self, duration: float) -> None:
        self._append(np.repeat(self._position[np.newaxis], round(duration / _STEP), axis=0))

    def _steps(self, kind: str, duration: float) -> NDArray:
        """Returns u = t / T at each step of one primitive of about this duration [s]; the last is 1."""
        duration *= self._tempo * self._style.kind_tempo[kind] * self._rng.lognormal(0.0, _PRIMITIVE_TEMPO)
        num_steps = max(5, round(duration / _STEP))
        return np.arange(1, num_steps + 1) / num_steps

    def _append(self, piece: NDArray) -> None:
        if len(piece):
            self._pieces.append(piece)
            self._position = piece[-1]


def _place_rails(hand: _Hand) -> None:
    for k, hole in enumerate(_RAIL_HOLES):
        hand.stroke(hand.place("rails", (-0.03 * k, 0.0, 0.0)), 0.95)
        hand.twiddle(0.4, 0.008)
        hand.stroke(hand.place("holes", hole), 1.3)
        hand.insert(1.25, 0.015, (0.0, 0.0, -0.04))
    hand.stroke(hand.place("rest"), 0.9)


def _place_screws(hand: _Hand) -> None:
    for side in (-0.12, 0.14):  # straighten both sides
        hand.stroke(hand.place("holes", (0.05, side, 0.08)), 0.75)
        hand.press((-0.06, 0.03, 0.0), 0.75)
    for hole in _SCREW_HOLES:
        hand.stroke(hand.place("screws"), 0.8)
        hand.twiddle(0.4, 0.010)
        hand.stroke(hand.place("holes", hole), 0.95)
        hand.insert(1.05, 0.012, (0.0, 0.0, -0.02))
    hand.stroke(hand.place("rest"), 0.9)


def _tighten_screws(hand: _Hand) -> None:
    for hole in _SCREW_HOLES[::2]:
        screw = hand.place("holes", hole)
        hand.stroke(screw + np.array([0.05, 0.0, 0.02]), 1.0)
        hand.twiddle(0.8, 0.010)
        for _ in range(hand.num_turns):
            hand.turn(screw, 0.065, 1.2)
    hand.stroke(hand.place("rest"), 0.9)


_SCRIPTS: dict[str, Callable[[_Hand], None]] = {
    "place_rails": _place_rails,
    "place_screws": _place_screws,
    "tighten_screws": _tighten_screws,
}


def generate_demonstrations(
    seed: int = 0, num_subjects: int = 5, num_trials: int = 4, sample_period: float = 0.1, variety: float = 1.0
) -> DemonstrationSet:
    """Makes the synthetic demonstrations of place_rails, place_screws and tighten_screws.

    Mean durations are about 22, 18 and 40 s as in the paper; the model is described at the top of this file.

    Args:
        seed: same seed, same demonstrations.
        num_subjects: how many people.
        num_trials: how many trials of each action per person; the reference of each action comes on top.
        sample_period: [s] a multiple of 0.01 s.
        variety: how much the styles of people differ, relative to what the model says; 2 makes unusual ones.

    Raises:
        InputError: an argument is out of range.
    """
    if not 0 <= variety < math.inf:
        raise InputError(f"variety of the demonstrations must be >= 0, got {variety}")
    for name, value in (("seed", seed + 1), ("num_subjects", num_subjects), ("num_trials", num_trials)):
        if value < 1:
            raise InputError(f"{name} of the demonstrations must be larger, got {value - (name == 'seed')}")
    stride = round(sample_period / _STEP)
    if stride < 1 or not math.isclose(stride * _STEP, sample_period):
        raise InputError(f"sample_period must be a multiple of {_STEP} s, got {sample_period}")

    styles = _styles(seed, num_subjects, variety)
    demonstrations: list[Demonstration] = []
    references: list[Demonstration] = []
    for index, action in enumerate(_SCRIPTS):
        trials = [
            [
                Demonstration(
                    action,
                    f"S{subject + 1}",
                    "reference" if trial == num_trials else f"T{trial + 1}",
                    sample_period,
                    _play(action, style, stride, np.random.default_rng((seed, 1, index, subject, trial))),
                    synthetic=True,
                )
                for trial in range(num_trials + 1)
            ]
            for subject, style in enumerate(styles)
        ]
        means = [np.mean([d.duration for d in of_subject[:-1]]) for of_subject in trials]
        references.append(trials[int(np.argsort(means)[(num_subjects - 1) // 2])][-1])
        demonstrations += [d for of_subject in trials for d in of_subject[:-1]]
    return DemonstrationSet(tuple(demonstrations), tuple(references))


def _play(action: str, style: _Style, stride: int, rng: np.random.Generator) -> NDArray:
    """Returns one trial as a sensor gives it (num_samples, 3) [m], a sample every `stride` steps."""
    hand = _Hand(style, rng)
    _SCRIPTS[action](hand)
    path = hand.path[::stride]
    offset = rng.normal(0.0, _SENSOR_OFFSET, 3) * (1.0, 1.0, 0.5)
    noise = rng.normal(0.0, _SENSOR_NOISE, path.shape)
    return path + _unsteadiness(len(path), stride * _STEP, rng) + offset + noise


def _styles(seed: int, num_subjects: int, variety: float = 1.0) -> list[_Style]:
    rngs = [np.random.default_rng((seed, 0, subject)) for subject in range(num_subjects)]
    # Tempos are the quantiles of their distribution in random order: five independent draws would often make
    # a group that is far from the paper's mean durations, or in which all people are alike.
    quantiles = ndtri((np.random.default_rng((seed, 2)).permutation(num_subjects) + 0.5) / num_subjects)
    log_tempo = variety * _SUBJECT_TEMPO * quantiles
    return [
        _Style(
            tempo=math.exp(log_tempo[subject]),
            kind_tempo={kind: rng.lognormal(0.0, variety * _SUBJECT_KIND_TEMPO) for kind in _KINDS},
            skew=rng.lognormal(0.0, variety * _SUBJECT_SKEW),
            lift=rng.uniform(0.08, 0.25),
            bend=rng.normal(0.0, variety * 0.08),
            amplitude=rng.lognormal(0.0, variety * _SUBJECT_AMPLITUDE),
            twiddle_rate=rng.uniform(1.5, 3.0),
            turn_angle=rng.uniform(1.6, 2.8),
            turn_start=rng.normal(-0.5, variety * 0.3),
            num_turns=14.0 + rng.normal(0.0, variety * _SUBJECT_TURNS),
            pause_probability=rng.uniform(0.0, 0.4),
            pause_duration=rng.uniform(0.3, 1.2),
            places={
                name: np.array(place) + rng.normal(0.0, variety * _SUBJECT_PLACE, 3) * (1.0, 1.0, 0.5)
                for name, place in _PLACES.items()
            },
        )
        for subject, rng in enumerate(rngs)
    ]


def _minimum_jerk(u: NDArray) -> NDArray:
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _unsteadiness(num_samples: int, sample_period: float, rng: np.random.Generator) -> NDArray:
    """Returns a stationary first-order Gauss-Markov process (num_samples, 3) [m]."""
    decay = math.exp(-sample_period / _UNSTEADINESS_TIME)
    noise = rng.normal(0.0, _UNSTEADINESS, (num_samples, 3))
    noise[1:] *= math.sqrt(1.0 - decay**2)
    # As scipy.signal.lfilter, whose import takes half a second.
    axes = [list(accumulate(axis, lambda before, fresh: fresh + decay * before)) for axis in noise.T.tolist()]
    return np.array(axes).T

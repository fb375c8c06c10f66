"""What the estimators show a policy: kept with a learned one, so that it is not used where they show something else."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pace_drake.observation import FUSED_SETS
from pace_drake.scenario import SYNTHETIC

if TYPE_CHECKING:
    from pace_drake.dtw.estimator import Estimator
    from pace_drake.people import People
    from pace_drake.scenario import Scenario

#: Where in an action estimates are taken, and by how much they may differ: absolutely and as a share.
_FRACTIONS = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
_TOLERANCE = 1e-3
_NAMES = ("phase", "phase_std", "remaining_time")


@dataclass(frozen=True)
class Estimates:
    """What the estimators of a scenario say of one known hand.

    Attributes:
        inputs: hash of what the scenario gives the estimators: people, settings, estimator file, durations. Where it
            differs, a policy is deliberately used with something else, such as a real person's references.
        values: per non-joint human action, what an observation has of ``phase``, ``phase_std``, ``remaining_time`` [s]
            at five places (5, 1 or 3) of a trial that no setting of the scenario's ``human.split`` changes.
    """

    inputs: str
    values: dict[str, NDArray]

    @classmethod
    def of(
        cls, scenario: "Scenario", people: "People", estimators: "Sequence[Estimator | None]", observation: str
    ) -> "Estimates | None":
        """Asks the estimators.

        Args:
            scenario: whose.
            people: of the scenario.
            estimators: those that ``people.estimators`` returned for it.
            observation: the set that a policy sees; None is returned where no estimate is in it.
        """
        if observation == "none":
            return None
        values = {}
        for k, (action, estimator) in enumerate(zip(scenario.task.human_actions, estimators, strict=True)):
            if estimator is None:
                continue
            # The last one, of somebody else than the reference: a reference says little of its own alignment.
            hand = (people.training[k] or people.demonstrations[k])[-1].resample(scenario.human.sample_period).p_WH
            at = np.rint(_FRACTIONS * (len(hand) - 1)).astype(int)
            hand = hand[: at[-1] + 1]
            if observation in FUSED_SETS:
                said = estimator.estimates(hand)
                values[action.name] = np.column_stack([getattr(said, name) for name in _NAMES])[at]
            else:
                values[action.name] = estimator.phase(hand)[at, np.newaxis]
        return cls(_inputs(scenario), values)

    def to_json(self) -> str:
        """Reads like ``from_json``."""
        return json.dumps(
            {"inputs": self.inputs, "values": {name: one.round(6).tolist() for name, one in self.values.items()}}
        )

    @classmethod
    def from_json(cls, text: str) -> "Estimates":
        """Raises ValueError unless ``text`` is from ``to_json``."""
        content = json.loads(text)
        try:
            values = {str(name): np.array(one, dtype=float) for name, one in content["values"].items()}
            found = cls(str(content["inputs"]), values)
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"no estimates: {error}") from error
        if any(one.shape not in ((len(_FRACTIONS), 1), (len(_FRACTIONS), len(_NAMES))) for one in values.values()):
            raise ValueError("estimates of another shape")
        return found

    def difference(self, now: "Estimates") -> str:
        """What is shown otherwise now, of the first action where it is; empty if nothing is or nothing is comparable.

        Args:
            now: of the same observation set.
        """
        if self.inputs != now.inputs:
            return ""
        for name, mine in self.values.items():
            theirs = now.values.get(name)
            if theirs is None or theirs.shape != mine.shape:
                return f"of {name}"
            wrong = ~np.isclose(theirs, mine, rtol=_TOLERANCE, atol=_TOLERANCE)
            if wrong.any():
                row, column = np.argwhere(wrong)[0]
                return f"of {name}: {_NAMES[column]} {mine[row, column]:.3f}, now {theirs[row, column]:.3f}"
        return ""


def _inputs(scenario: "Scenario") -> str:
    def digest(file: str) -> str:
        return sha256(scenario.resolve(file).read_bytes()).hexdigest() if file else ""

    def given(config: Any) -> dict[str, Any]:
        # Without what is as by default: a setting that is new in a later version changes nothing.
        default = type(config)()
        return {f.name: v for f in fields(config) if (v := getattr(config, f.name)) != getattr(default, f.name)}

    human = scenario.human
    content = {
        "actions": {
            action.name: [given(action.duration), given(scenario.estimator_of(action.name))]
            for action in scenario.task.human_actions
            if not action.joint
        },
        "estimator_file": digest(scenario.estimator_file),
        "demonstrations": "" if human.demonstrations == SYNTHETIC else digest(human.demonstrations),
        "seed": human.seed,
        "sample_period": human.sample_period,
    }
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

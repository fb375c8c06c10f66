"""Which of what the robot knows of people is of SYNTHETIC ones, to be said where the person is real."""

import json
from contextlib import suppress
from pathlib import Path

from pace_drake.dtw.estimator_file import read_estimator_file
from pace_drake.people import People
from pace_drake.policies.factory import policy_name
from pace_drake.scenario import SYNTHETIC, Scenario, load_scenario, scenario_names


def synthetic_parts(scenario: Scenario, people: People) -> list[str]:
    """Names what was made from SYNTHETIC people: references and durations of actions, and the policy.

    Args:
        scenario: names estimators and policy.
        people: those of the scenario.

    Returns:
        Texts for people; empty if nothing is known to be synthetic.
    """
    tuned = read_estimator_file(scenario.resolve(scenario.estimator_file)) if scenario.estimator_file else None
    of_file = {} if tuned is None else dict.fromkeys(tuned.actions, "SYNTHETIC" in tuned.description)
    actions = [
        action.name
        for action, reference in zip(scenario.task.human_actions, people.references, strict=True)
        if reference is not None and of_file.get(action.name, reference.synthetic)
    ]
    parts = [f"references and durations of {', '.join(actions)}"] if actions else []
    if _policy_is_synthetic(scenario):
        parts.append(f"policy {scenario.policy}")
    return parts


def _policy_is_synthetic(scenario: Scenario) -> bool:
    if scenario.policy.endswith(".onnx"):
        return _card_says_so(Path(scenario.policy))
    name = policy_name(scenario.policy)
    if name == "learned":
        return _card_says_so(scenario.resolve(scenario.learned_policy))
    if not name.endswith("_threshold"):
        return False
    # Thresholds do not say where they come from: from the scenario's people, or left as they were in a shipped one.
    shipped = [getattr(load_scenario(one), name) for one in scenario_names()]
    return scenario.human.demonstrations == SYNTHETIC or getattr(scenario, name) in shipped


def _card_says_so(policy: Path) -> bool:
    """Whether the card that `pace train` wrote beside a policy says that its people were synthetic."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        return "SYNTHETIC" in json.loads(policy.with_suffix(".json").read_text(encoding="utf-8"))["score"]["people"]
    return False

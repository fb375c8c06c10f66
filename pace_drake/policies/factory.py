"""Policies by name, as the command line and scenarios write them."""

from math import inf
from pathlib import Path

from pace_drake.errors import InputError
from pace_drake.policies import Policy
from pace_drake.policies.learned import LearnedPolicy
from pace_drake.policies.rules import (
    AlwaysAssist,
    ExplicitQuery,
    NeverAssist,
    RemainingTimeThreshold,
    Threshold,
    joint_actions,
)
from pace_drake.scenario import Scenario

POLICIES = (
    "explicit_query",
    "always_assist",
    "never_assist",
    "elapsed_threshold",
    "phase_threshold",
    "remaining_time_threshold",
    "learned",
)


def make_policy(name: str, scenario: Scenario, any_observation: bool = False) -> Policy:
    """Returns a policy.

    Args:
        name: one of ``POLICIES`` (hyphens and unambiguous beginnings are understood), or the path of an ONNX file.
        scenario: gives thresholds and the default learned policy.
        any_observation: whether a learned policy may see another observation set than the scenario's.

    Raises:
        InputError: unknown name, or a policy that cannot be made in this scenario.
    """
    task = scenario.task
    seen = None if any_observation else scenario.observation
    if name.endswith(".onnx"):
        return LearnedPolicy(name, task, seen)
    if name.endswith(".zip"):
        raise InputError(
            f"{name}: a file of Stable-Baselines3 holds a pickle and is not read here; make a policy file of it, once:"
            f" pace export {name} --trust-pickle -o {Path(name).stem}.onnx"
        )
    joint = joint_actions(task)
    match policy_name(name):
        case "explicit_query":
            return ExplicitQuery(joint)
        case "always_assist":
            return AlwaysAssist()
        case "never_assist":
            return NeverAssist()
        case "elapsed_threshold":
            return Threshold(2, _thresholds(scenario, "elapsed_threshold"), joint)
        case "phase_threshold":
            return Threshold(3, _thresholds(scenario, "phase_threshold"), joint)
        case "remaining_time_threshold":
            return RemainingTimeThreshold(_thresholds(scenario, "remaining_time_threshold", -inf), joint)
        case _:
            return LearnedPolicy(_learned_path(scenario), task, seen)


def policy_name(text: str) -> str:
    """Which of ``POLICIES`` is meant; hyphens, spaces and unambiguous beginnings are understood.

    Raises:
        InputError: none, or several.
    """
    key = text.strip().lower().replace("-", "_").replace(" ", "_")
    matches = [policy for policy in POLICIES if key and policy.startswith(key)]
    if len(matches) != 1:
        raise InputError(f"unknown policy {text!r}; use one of {', '.join(POLICIES)}, or a file ending in .onnx")
    return matches[0]


def _thresholds(scenario: Scenario, name: str, never: float = inf) -> tuple[float, ...]:
    values: dict[str, float] = getattr(scenario, name)
    if not values:
        raise InputError(f"scenario {scenario.name!r} has no {name}; give one value per human action")
    return tuple(values.get(action.name, never) for action in scenario.task.human_actions)


def _learned_path(scenario: Scenario) -> Path:
    if not scenario.learned_policy:
        raise InputError(f"scenario {scenario.name!r} names no learned_policy; train one with 'pace train'")
    return scenario.resolve(scenario.learned_policy)

"""Demonstrations of human actions: model, files, and a generator of synthetic ones. Needs no Drake."""

from pace_drake.demos.files import read_demonstrations, write_demonstrations
from pace_drake.demos.generator import generate_demonstrations
from pace_drake.demos.model import Demonstration, DemonstrationSet

__all__ = [
    "Demonstration",
    "DemonstrationSet",
    "generate_demonstrations",
    "read_demonstrations",
    "write_demonstrations",
]

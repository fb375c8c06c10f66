"""Demonstrations of human actions: model, files, and a generator of synthetic ones. Needs no Drake."""

from pace_drake.demos.files import read_demonstrations, write_demonstrations
from pace_drake.demos.generator import generate_demonstrations
from pace_drake.demos.model import Demonstration, DemonstrationSet
from pace_drake.demos.signals import (
    ActionSignals,
    Signal,
    SignalSet,
    folder_signals,
    signal_of,
    synthetic_signals,
    watch_signals,
)
from pace_drake.demos.watch import WatchRecording, read_watch

__all__ = [
    "ActionSignals",
    "Demonstration",
    "DemonstrationSet",
    "Signal",
    "SignalSet",
    "WatchRecording",
    "folder_signals",
    "generate_demonstrations",
    "read_demonstrations",
    "read_watch",
    "signal_of",
    "synthetic_signals",
    "watch_signals",
    "write_demonstrations",
]

"""How far an action has come, from a hand's motion: open-end soft-DTW and what builds on it. Without Drake."""

from pace_drake.dtw.baselines import ConstantPhase, TimeOnly
from pace_drake.dtw.end import EndDetector
from pace_drake.dtw.ensemble import MedianPhase
from pace_drake.dtw.estimator import Estimate, Estimator
from pace_drake.dtw.filter import Calibration, PhaseFilter
from pace_drake.dtw.gate import MovementGate
from pace_drake.dtw.monotone import Monotone
from pace_drake.dtw.open_end import DISTANCES, NORMALIZATIONS, STEPS, Distance, Normalization, OpenEndSoftDTW, Steps
from pace_drake.dtw.promp import ProMP
from pace_drake.dtw.recognizer import ActionRecognizer
from pace_drake.dtw.several import SeveralReferences

__all__ = [
    "DISTANCES",
    "NORMALIZATIONS",
    "STEPS",
    "ActionRecognizer",
    "Calibration",
    "ConstantPhase",
    "Distance",
    "EndDetector",
    "Estimate",
    "Estimator",
    "MedianPhase",
    "Monotone",
    "MovementGate",
    "Normalization",
    "OpenEndSoftDTW",
    "PhaseFilter",
    "ProMP",
    "SeveralReferences",
    "Steps",
    "TimeOnly",
]

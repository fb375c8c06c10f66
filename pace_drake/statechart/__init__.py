"""Statecharts in SCXML as pure reaction functions; no Drake import."""

from pace_drake.statechart.compile import CompiledChart, NoRestError, compile_chart
from pace_drake.statechart.loader import load_chart
from pace_drake.statechart.model import Chart, State, Transition

__all__ = ["Chart", "CompiledChart", "NoRestError", "State", "Transition", "compile_chart", "load_chart"]

"""Proves what must hold of a chart in its surroundings: ``pace chart check``."""

from pace_drake.statechart.check.spec import checks_path, load_spec
from pace_drake.statechart.check.verdict import Report, Row, Verdict, check, check_chart

__all__ = ["Report", "Row", "Verdict", "check", "check_chart", "checks_path", "load_spec"]

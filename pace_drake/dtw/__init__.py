"""Open-end soft-DTW with the Windowed-Pearson distance: the phase of a human action, without Drake."""

from pace_drake.dtw.open_end import DISTANCES, Distance, OpenEndKernel, OpenEndSoftDTW, phase

__all__ = ["DISTANCES", "Distance", "OpenEndKernel", "OpenEndSoftDTW", "phase"]

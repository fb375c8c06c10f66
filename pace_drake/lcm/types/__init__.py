"""LCM types of this project: the ``.lcm`` files here, and what ``lcm-gen -p`` makes of them (docs/lcm.md)."""

from pace_drake.lcm.types.lcmt_pace_decision import lcmt_pace_decision
from pace_drake.lcm.types.lcmt_pace_hand import lcmt_pace_hand
from pace_drake.lcm.types.lcmt_pace_operator import lcmt_pace_operator
from pace_drake.lcm.types.lcmt_pace_state import lcmt_pace_state

__all__ = ["lcmt_pace_decision", "lcmt_pace_hand", "lcmt_pace_operator", "lcmt_pace_state"]

"""PACE as one Drake diagram: a robot arm that helps a person at the right moment.

Importing the package registers its Gymnasium environments and nothing more: ``pace_drake.dtw`` and
``pace_drake.statechart`` load without Drake.
"""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

register("PaceAssembly-v0", entry_point="pace_drake.envs.assembly_env:PaceAssemblyEnv")
register(
    "PaceAssemblyNoPhase-v0",
    entry_point="pace_drake.envs.assembly_env:PaceAssemblyEnv",
    kwargs={"observation": "none"},
)

"""PACE as one Drake diagram: a robot arm that helps a person at the right moment.

Importing the package registers its Gymnasium environments and nothing more: ``pace_drake.dtw`` and
``pace_drake.statechart`` load without Drake.
"""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

for _id, _kwargs in (("PaceAssembly-v0", {}), ("PaceAssemblyNoPhase-v0", {"observation": "none"})):
    register(
        _id,
        entry_point="pace_drake.envs.assembly_env:PaceAssemblyEnv",
        vector_entry_point="pace_drake.envs.vector_env:PaceAssemblyVectorEnv",
        kwargs=_kwargs,
    )

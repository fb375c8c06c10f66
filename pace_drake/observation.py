"""What a policy may see of the collaboration: the elements of an observation, and the sets that are compared."""

from pace_drake.errors import require

#: Elements of an observation, in order. Each set of ``OBSERVATION_SETS`` is a beginning of it.
#:
#: robot_task: i, the last robot task started [1-based]. human_action: j [1-based]; a joint action means that the person
#: waits for it. human_elapsed [s]: time since that action, or the waiting, began. phase in [0, 1]: of that action.
#: phase_std [-], remaining_time [s]: what the phase filter adds, 0 in joint actions. pace [-]: mean, over the actions
#: that this person has finished by themselves, of their duration over its mean; 1 before the first.
OBSERVATION = ("robot_task", "human_action", "human_elapsed", "phase", "phase_std", "remaining_time", "pace")

#: By name, how many elements of ``OBSERVATION`` are seen: ``none`` knows time only, ``paper`` is the paper's O(s),
#: ``fused`` adds what a Bayesian filter makes of alignment and time, ``history`` the person's pace so far.
OBSERVATION_SETS = {"none": 3, "paper": 4, "fused": 6, "history": 7}

#: In these sets the phase is the mean of the phase filter, whatever the estimator's ``fused`` says.
FUSED_SETS = ("fused", "history")

#: [s] bound of times in observation spaces; longer ones are clipped to it.
MAX_TIME = 3600.0


def check_observation(name: str, where: str = "observation") -> None:
    """Raises InputError unless ``name`` is an observation set."""
    require(name in OBSERVATION_SETS, where, f"must be one of {', '.join(OBSERVATION_SETS)}, is {name!r}")

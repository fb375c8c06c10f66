"""The compiled advance of a chart, from decision to decision: what the twin runs in every environment.

Numba keeps on disk only what stands in a file and closes over nothing. So a module of its own is written for every
chart: the chart's functions, its numbers as constants, and the functions of this file as they stand here. It goes to
the user's cache, by the hash of its text; compiling it takes three seconds once, loading it a fraction of one.
"""

import importlib.util
import inspect
import sys
from functools import cache
from hashlib import sha256
from typing import Any

import numba
import numpy as np
from numba import prange, types

from pace_drake.envs.pool import NUM_ESTIMATES
from pace_drake.files import cache_folder, write_whole
from pace_drake.statechart import CompiledChart
from pace_drake.statechart.compile import MAX_CHAIN
from pace_drake.task import NUM_ROBOT_DRAWS, ActionKind

DECISION, FINISHED, NO_EVENT, NO_REST = 1, 2, 3, 4

# Constants of every kernel: places in the robot's state, and kinds of its actions.
NUMBER, KIND, INDEX, DURATION, SINCE, ACTIVE, DONE = range(7)
KIND_TASK, KIND_PREPARE, KIND_JOINT, KIND_NONE, KIND_HOLD = (
    float(kind)
    for kind in (ActionKind.ROBOT_TASK, ActionKind.PREPARE, ActionKind.JOINT, ActionKind.NONE, ActionKind.HOLD)
)

# What is the chart's, and has its values only in the module that is made for it.
IN_A = IN_DONE = IN_RB = IN_HJ = IN_NJ = 0
OUT_KIND = OUT_INDEX = OUT_NUMBER = OUT_READY = OUT_WAITING = 0
PLACE_I = 0
ABSENT = 0.0
#: Where each part of a row of the state begins: chart, person (2), robot (7), idle meter (3 + 2 L), durations, inputs.
OF_PERSON = OF_ROBOT = OF_IDLE = 0
NUM_INPUTS = 0
U0 = np.zeros(0)
DECIDES = FINAL = np.zeros(0, dtype=bool)
react_in_place: Any = None
outputs: Any = None
next_deadline: Any = None
address: Any = None


def make_kernel(compiled: CompiledChart, parallel: bool) -> Any:
    """The function ``advance`` (see there) of a chart, compiled; threads share the environments if ``parallel``."""
    return _load(_text(compiled, parallel))


def _text(compiled: CompiledChart, parallel: bool) -> str:
    chart = compiled.chart
    of_person = 1 + len(chart.histories) + len(chart.variables)
    constants: dict[str, Any] = {
        "ABSENT": chart.inputs["a"],
        "PLACE_I": compiled.variable_index["i"],
        "NUM_INPUTS": len(chart.inputs),
        "OF_PERSON": of_person,
        "OF_ROBOT": of_person + 2,
        "OF_IDLE": of_person + 9,
    }
    for name in ("a", "done", "rb", "hj", "nj"):
        constants[f"IN_{name.upper()}"] = compiled.input_index[name]
    for name in ("kind", "index", "number", "joint_ready", "robot_waiting"):
        constants[f"OUT_{name.rpartition('_')[2].upper()}"] = compiled.output_index[name]
    own = "NUMBER KIND INDEX DURATION SINCE ACTIVE DONE KIND_TASK KIND_PREPARE KIND_JOINT KIND_NONE KIND_HOLD DECISION"
    for name in f"{own} FINISHED NO_EVENT NO_REST MAX_CHAIN NUM_ESTIMATES NUM_ROBOT_DRAWS".split():
        constants[name] = globals()[name]
    decides = [chart.states[leaf].decision is not None for leaf in chart.leaves]
    final = [any(chart.states[s].final for s in chart.ancestors(leaf)) for leaf in chart.leaves]
    arrays = {"U0": [float(value) for value in compiled.inputs()], "DECIDES": decides, "FINAL": final}
    inner = (compiled.source, *(inspect.getsource(one) for one in _PARTS))
    lines = [
        f'"""Written by pace_drake for the chart {chart.name} and numba {numba.__version__}; may be deleted."""',
        "import math",
        "from math import inf, nan",
        "import numpy as np",
        "from numba import njit, prange, types",
        "from numba.extending import intrinsic",
        *(f"{name} = {value!r}" for name, value in sorted(constants.items())),
        *(f"{name} = np.array({value!r})" for name, value in arrays.items()),
        inspect.getsource(address_of_element),
        "address = intrinsic(address_of_element)",
        # Nothing calls these from Python, or looks for them in the cache.
        *(_decorated(text, "@njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)") for text in inner),
        _decorated(inspect.getsource(advance), f"@njit(cache=True, parallel={parallel})"),
    ]
    return "\n".join(lines)


def _decorated(source: str, decorator: str) -> str:
    return "\n".join(f"{decorator}\n{line}" if line.startswith("def ") else line for line in source.splitlines())


@cache
def _load(text: str) -> Any:
    path = cache_folder("kernels") / f"twin_{sha256(text.encode()).hexdigest()[:24]}.py"
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_whole(path, lambda part: part.write_text(text, encoding="utf-8"))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # numba finds what it has kept by this name
    spec.loader.exec_module(module)
    return module.advance


def address_of_element(_, array, index):
    """Where an element of a contiguous array lies, counted from its first.

    The functions below take addresses: numba counts references to an array or a slice that is handed on, which took
    most of the time of a decision, and half of the time to compile. The arrays are the caller's, who holds them.
    """

    def generate(context, builder, signature, values):
        first = context.make_array(signature.args[0])(context, builder, values[0]).data
        return builder.gep(first, [values[1]])

    return types.CPointer(array.dtype)(array, types.intp), generate


def person_now(human, num_actions, person, alpha, joints, time):
    """(action, its start, waiting, joint, joints done, next event), as ``systems.Human._now``."""
    begun, start = int(person[0]), person[1]
    first = alpha[begun - 1] if begun > 0 else 1
    waits = begun < joints
    end = alpha[begun] if waits else num_actions + 1
    done = max(begun - 1, 0)
    for action in range(first, end):
        until = start + human[action - 1]
        if time < until:
            return action, start, False, begun if begun > 0 and action == first else 0, done, until
        done, start = begun, until
    if waits:
        return end, start, True, begun + 1, begun, np.inf
    return num_actions, start, False, 0, done, np.inf


def ticks_before(time, period):
    """How many ticks of the tracker (at 0, period, ...) are before ``time``."""
    k = max(int(time / period) - 1, 0)
    while k * period < time:
        k += 1
    return k


def to_rest(x, u, p, time):
    """Lets the chart react until nothing is enabled; False if that does not end."""
    reactions = 0
    while react_in_place(x, u, p, time) >= 0:
        reactions += 1
        if reactions > MAX_CHAIN:
            return False
    return True


def observe(now, x, idle, parts, time, sizes, looked_up, period, observation, robot_idle, human_idle):
    """Writes what can be seen now: the observation and the idle times up to now."""
    size, joints = sizes[1], sizes[2]
    human, phase_start, phase_length, phases, before, per_mean = looked_up
    action, start = now[0], now[1]
    observation[0], observation[1], observation[2] = x[PLACE_I], action, time - start
    # The estimator has seen one sample at each tick since the action began; after its end the last one counts.
    pair = (action - 1) * size + parts[action - 1]
    ticks = ticks_before(time, period) - ticks_before(start, period)
    at = phase_start[pair] + min(ticks, phase_length[pair]) - 1
    for k in range(NUM_ESTIMATES):
        if ticks > 0:
            observation[3 + k] = phases[at * NUM_ESTIMATES + k]
        else:
            observation[3 + k] = before[(action - 1) * NUM_ESTIMATES + k]
    # The mean ratio of the actions that the person has finished alone, to what they take on average.
    total, count = 0.0, 0
    for k in range(action - 1):
        if per_mean[k] > 0:
            total += human[k * size + parts[k]] * per_mean[k]
            count += 1
    observation[7] = total / count if count > 0 else 1.0
    for k in range(joints):
        robot_idle[k], human_idle[k] = idle[3 + k], idle[3 + joints + k]
    if idle[1] > 0:
        robot_idle[int(idle[1]) - 1] += time - idle[0]
    if idle[2] > 0:
        human_idle[int(idle[2]) - 1] += time - idle[0]


def begin(robot, values, parts, time, sizes, drawn, alpha):
    """The robot begins what the chart commands."""
    n, joints, num_tasks = sizes[0], sizes[2], sizes[3]
    robot_draws, preparation, joint_draws, homing = drawn
    kind, number, index = values[OUT_KIND], values[OUT_NUMBER], int(values[OUT_INDEX]) - 1
    if kind == KIND_TASK:
        draw = parts[n] * NUM_ROBOT_DRAWS + (int(number) - 1) % NUM_ROBOT_DRAWS
        robot[DURATION] = robot_draws[draw * num_tasks + index]
    elif kind == KIND_PREPARE:
        robot[DURATION] = preparation[parts[n + 1] * joints + index]
    elif kind == KIND_JOINT:
        robot[DURATION] = joint_draws[parts[alpha[index] - 1] * joints + index]
    else:
        robot[DURATION] = homing[parts[n + 2] * joints + index]
    robot[KIND], robot[INDEX], robot[NUMBER] = kind, index + 1, number
    robot[SINCE], robot[ACTIVE] = time, 1.0


def advance_one(
    answer, x, person, robot, idle, seconds, u, parts, sizes, drawn, looked_up, x0, p, alpha, period, time,
    observation, robot_idle, human_idle,
):  # fmt: skip
    """Advances one environment to its next decision, or to the end: (status, time [s])."""
    n, size, joints = sizes[0], sizes[1], sizes[2]
    if np.isnan(answer):  # a fresh start
        for k in range(OF_PERSON):
            x[k] = x0[k]
        for k in range(NUM_INPUTS):
            u[k] = U0[k]
        person[0] = person[1] = 0.0
        for k in range(OF_IDLE - OF_ROBOT):
            robot[k] = 0.0
        for k in range(3 + 2 * joints):
            idle[k] = 0.0
        for k in range(n):
            seconds[k] = looked_up[0][k * size + parts[k]]
        time = 0.0
    while True:
        done = robot[ACTIVE] > 0 and time >= robot[SINCE] + robot[DURATION]
        now = person_now(seconds, n, person, alpha, joints, time)
        u[IN_A] = ABSENT
        u[IN_DONE] = robot[NUMBER] if done else robot[DONE]
        u[IN_RB] = 1.0 if robot[ACTIVE] > 0 and not done else 0.0
        u[IN_HJ], u[IN_NJ] = now[3], now[4]
        # The chart reads the same in one instant, so that it may wait in DECIDE for the answer.
        if not to_rest(x, u, p, time):
            return NO_REST, time
        if DECIDES[int(x[0])]:
            if np.isnan(answer):
                status = DECISION
                break
            u[IN_A] = answer
            react_in_place(x, u, p, time)
            u[IN_A] = ABSENT
            answer = np.nan
            if not to_rest(x, u, p, time):
                return NO_REST, time
        # Then the robot, the person and the idle meter: each sees what those before it have done.
        values = outputs(x, p)
        if done:
            robot[DONE], robot[ACTIVE] = robot[NUMBER], 0.0
        kind = values[OUT_KIND]
        if kind != KIND_HOLD and kind != KIND_NONE and values[OUT_NUMBER] != robot[NUMBER]:
            begin(robot, values, parts, time, sizes, drawn, alpha)
        if now[2] and values[OUT_READY] == now[3]:
            person[0], person[1] = now[3], time
            now = person_now(seconds, n, person, alpha, joints, time)
        if idle[1] > 0:
            idle[2 + int(idle[1])] += time - idle[0]
        if idle[2] > 0:
            idle[2 + joints + int(idle[2])] += time - idle[0]
        idle[0], idle[1], idle[2] = time, values[OUT_WAITING], now[3] if now[2] else 0.0
        if FINAL[int(x[0])]:
            status = FINISHED
            break
        following = min(now[5], next_deadline(x, u, p, time))
        if robot[ACTIVE] > 0:
            following = min(following, robot[SINCE] + robot[DURATION])
        if following == np.inf:
            return NO_EVENT, time
        time = following
    observe(now, x, idle, parts, time, sizes, looked_up, period, observation, robot_idle, human_idle)
    return status, time


def advance(envs, answers, state, parts, draws, time, observation, robot_idle, human_idle, status):
    """Advances environments, and returns the worst status.

    Args:
        envs: (n,) which.
        answers: (n,) 0 or 1, the decision that each awaits; NaN starts an episode.
        state, parts, time, observation, robot_idle, human_idle, status: of all environments, as in ``AssemblyTwin``.
        draws: the pool and the constants of the scenario; like all arrays contiguous.
    """
    n, size = draws[0].shape
    joints = robot_idle.shape[1]
    sizes = (n, size, joints, draws[1].shape[1] // NUM_ROBOT_DRAWS)
    of_seconds = OF_IDLE + 3 + 2 * joints
    worst = 0
    for k in prange(len(envs)):
        e = envs[k]
        row = e * state.shape[1]
        status[e], time[e] = advance_one(
            answers[k],
            address(state, row),
            address(state, row + OF_PERSON),
            address(state, row + OF_ROBOT),
            address(state, row + OF_IDLE),
            # Kept from call to call, as the inputs after them: to allocate them would take a tenth of the time.
            address(state, row + of_seconds),
            address(state, row + of_seconds + n),
            address(parts, e * parts.shape[1]),
            sizes,
            (address(draws[1], 0), address(draws[2], 0), address(draws[3], 0), address(draws[4], 0)),
            (
                address(draws[0], 0), address(draws[5], 0), address(draws[6], 0), address(draws[7], 0),
                address(draws[11], 0), address(draws[12], 0),
            ),
            address(draws[8], 0),
            address(draws[9], 0),
            address(draws[10], 0),
            draws[13],
            time[e],
            address(observation, e * observation.shape[1]),
            address(robot_idle, e * joints),
            address(human_idle, e * joints),
        )  # fmt: skip
        worst = max(worst, status[e])
    return worst


#: Of every kernel, each after those that it calls; ``advance`` comes last.
_PARTS = (person_now, ticks_before, to_rest, observe, begin, advance_one)

"""TaskStatechart: runs the chart of the collaboration (PACE, Fig. 2)."""

from functools import partial

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pace_drake.errors import InputError
from pace_drake.statechart import CompiledChart
from pace_drake.systems.ports import declare_input, declare_output, declare_update
from pace_drake.task import ActionKind

#: A chain of reactions at one instant ends after this many; a chart that needs more does not come to rest.
MAX_CHAIN = 8
_REQUIRED = {"variables": ("i", "l", "cmd", "d", "ab"), "inputs": ("a", "done")}


class TaskStatechart(LeafSystem):
    """Runs a compiled chart: one update reacts until nothing more is enabled, so zero-time chains take no time.

    Inputs:
        One (1) port for each input that the chart declares, except the decision. For ``pace_task.scxml``:
        start, stop, fault, ack (operator), done (motion_done), rb (robot_busy), hj (human_joint), nj (joints_done).
        An unconnected port has the value that the chart declares.
        assist (1) in {-1 none yet, 0, 1}: read inside the update, and only in a state that decides.

    Outputs:
        mode (1): index of the active leaf state in ``chart.leaves``.
        robot_task (1): i, the last robot task started [1-based].
        joint_action (1): l, the next joint action [1-based].
        robot_action (3): kind (``ActionKind``), index (i or l), sequence number of the command.
        joint_ready (1): l while the robot is ready to perform joint action l with the person, else 0.
        robot_waiting (1): l while the robot waits, prepared, for the person, else 0.
        decision_pending (1): 1 if an update now would come to a decision. Depends on state, time and the inputs
            other than assist, so an adapter that answers it sees what the policy inside the diagram sees.
        decision_index (1): d, the number of decisions asked for.
        finished (1): 1 in a final state.
        trace (MAX_CHAIN): indices of the transitions that fired in the last update, padded with -1.
        next_event_time (1) [s]: when a timed guard of the active state becomes true; inf if none will.

    State:
        One numeric vector: x of the chart, then the trace. All of it is in the Context.

    Parameters:
        Numeric vector p of the chart.

    Args:
        compiled: the chart.
        parameters: values for p, as ``compiled.parameters(...)`` gives them.
        initial_state: x before the first reaction, as ``compiled.initial_state(...)`` gives it.
        reaction_period: see ``declare_update``.
    """

    def __init__(
        self,
        compiled: CompiledChart,
        parameters: np.ndarray,
        initial_state: np.ndarray,
        reaction_period: float | None = None,
    ) -> None:
        super().__init__()
        self.set_name("task_statechart")
        chart = compiled.chart
        for group, names in _REQUIRED.items():
            for name in names:
                if name not in getattr(chart, group):
                    raise InputError(f"{chart.path}: the task chart needs {name!r} among its {group}")
        self._compiled = compiled
        leaves = [chart.states[leaf] for leaf in chart.leaves]
        for state in leaves:
            command = state.marks.get("command", "NONE")
            if command not in ActionKind.__members__:
                raise InputError(f"{chart.path}:{state.line}: {state.id!r} commands the unknown action {command!r}")
        variable = compiled.variable_index
        self._kind = [ActionKind[state.marks.get("command", "NONE")] for state in leaves]
        self._index = [variable[state.marks["index"]] if "index" in state.marks else None for state in leaves]
        self._waiting = [variable[state.marks["waiting"]] if "waiting" in state.marks else None for state in leaves]
        self._decides = [state.marks.get("decision") == "a" for state in leaves]
        self._final = [state.marks.get("final") == "true" for state in leaves]
        self._num_x = len(initial_state)

        self.DeclareDiscreteState(np.concatenate([initial_state, np.full(MAX_CHAIN, -1.0)]))
        self._p = self.DeclareNumericParameter(BasicVector(parameters))
        self._inputs = {name: declare_input(self, name) for name in chart.inputs if name != "a"}
        self._assist = declare_input(self, "assist")
        self._defaults = compiled.inputs()

        stored = {self.xd_ticket()}
        pending = {
            self.xd_ticket(),
            self.time_ticket(),
            *(self.input_port_ticket(port.get_index()) for port in self._inputs.values()),
        }
        declare_output(self, "mode", partial(self._element, 0), stored)
        declare_output(self, "robot_task", partial(self._element, variable["i"]), stored)
        declare_output(self, "joint_action", partial(self._element, variable["l"]), stored)
        declare_output(self, "robot_action", self._robot_action, stored, size=3)
        declare_output(self, "joint_ready", self._joint_ready, stored)
        declare_output(self, "robot_waiting", self._robot_waiting, stored)
        declare_output(self, "decision_pending", self._decision_pending, pending)
        declare_output(self, "decision_index", partial(self._element, variable["d"]), stored)
        declare_output(self, "finished", self._finished, stored)
        declare_output(self, "trace", lambda context: self._state(context)[self._num_x :], stored, size=MAX_CHAIN)
        declare_output(self, "next_event_time", self._next_event_time, {self.xd_ticket(), self.time_ticket()})
        declare_update(self, self._update, reaction_period)

    @property
    def compiled(self) -> CompiledChart:
        """The chart that runs."""
        return self._compiled

    def chart_state(self, context: Context) -> np.ndarray:
        """A copy of x, the chart's part of the state."""
        return self._state(context)[: self._num_x].copy()

    def fired(self, context: Context) -> list[str]:
        """Ids of the transitions that the last update took, in order."""
        trace = self._state(context)[self._num_x :]
        return [self._compiled.chart.transitions[int(k)].id for k in trace if k >= 0]

    def _state(self, context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _element(self, index: int, context: Context) -> float:
        return self._state(context)[index]

    def _robot_action(self, context: Context) -> tuple[float, float, float]:
        x = self._state(context)
        variable = self._compiled.variable_index
        leaf = int(x[0])
        kind, index = self._kind[leaf], self._index[leaf]
        if kind == ActionKind.HOME and x[variable["ab"]] == 1:
            kind = ActionKind.HOME_ABORTED
        return float(kind), 0.0 if index is None else x[index], x[variable["cmd"]]

    def _joint_ready(self, context: Context) -> float:
        x = self._state(context)
        leaf = int(x[0])
        index = self._index[leaf]
        return x[index] if self._kind[leaf] == ActionKind.JOINT and index is not None else 0.0

    def _robot_waiting(self, context: Context) -> float:
        x = self._state(context)
        index = self._waiting[int(x[0])]
        return 0.0 if index is None else x[index]

    def _finished(self, context: Context) -> float:
        return float(self._final[int(self._state(context)[0])])

    def _read_inputs(self, context: Context) -> np.ndarray:
        """u of the chart, with the decision absent."""
        u = self._defaults.copy()
        place = self._compiled.input_index
        for name, port in self._inputs.items():
            if port.HasValue(context):
                u[place[name]] = port.Eval(context)[0]
        u[place["a"]] = -1.0
        return u

    def _decision(self, context: Context) -> float:
        """The answer on the assist port; anything but 0 and 1 counts as no answer."""
        if not self._assist.HasValue(context):
            return -1.0
        value = self._assist.Eval(context)[0]
        return value if value in (0.0, 1.0) else -1.0

    def _chain(self, context: Context, decide: bool) -> tuple[np.ndarray, list[int]]:
        """Reacts until nothing is enabled; with ``decide`` False it stops before the decision is read."""
        x = self._state(context)[: self._num_x]
        u = self._read_inputs(context)
        a = self._compiled.input_index["a"]
        p, t = context.get_numeric_parameter(self._p).value(), context.get_time()
        fired: list[int] = []
        asked = False
        while True:
            u[a] = -1.0
            if decide and not asked and self._decides[int(x[0])]:
                u[a] = self._decision(context)
                asked = True
            x_next, transition = self._compiled.react(x, u, p, t)
            if transition < 0:
                return x, fired
            if len(fired) == MAX_CHAIN:
                names = [self._compiled.chart.transitions[k].id for k in fired]
                raise RuntimeError(f"the chart does not come to rest at t = {t} s: {' '.join(names)} ...")
            fired.append(transition)
            x = x_next

    def _decision_pending(self, context: Context) -> float:
        x, _ = self._chain(context, decide=False)
        return float(self._decides[int(x[0])])

    def _next_event_time(self, context: Context) -> float:
        x = self._state(context)[: self._num_x]
        p = context.get_numeric_parameter(self._p).value()
        return self._compiled.next_deadline(x, self._defaults, p, context.get_time())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        x, fired = self._chain(context, decide=True)
        trace = np.full(MAX_CHAIN, -1.0)
        trace[: len(fired)] = fired
        values.set_value(np.concatenate([x, trace]))

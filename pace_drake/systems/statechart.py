"""StatechartSystem: runs any chart of ``pace_drake.statechart`` as a LeafSystem."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import isfinite

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem

from pace_drake.errors import InputError
from pace_drake.ports import declare_input, declare_output, declare_update
from pace_drake.statechart import Chart, CompiledChart
from pace_drake.statechart.compile import MAX_CHAIN

_OWN_OUTPUTS = ("mode", "finished", "decision_pending", "next_event_time", "trace")
#: Places in the trace: time [s] and leaf before the update, transitions taken, leaves in which they ended.
_TIME, _BEFORE, _FIRED, _AFTER = 0, 1, slice(2, 2 + MAX_CHAIN), slice(2 + MAX_CHAIN, 2 + 2 * MAX_CHAIN)
TRACE_SIZE = 2 + 2 * MAX_CHAIN


@dataclass(frozen=True)
class Reaction:
    """One transition taken.

    Attributes:
        time: [s].
        transition: its id.
        source, target: leaf states before and after.
        exited: states left, innermost first.
        entered: states entered, outermost first.
    """

    time: float
    transition: str
    source: str
    target: str
    exited: tuple[str, ...]
    entered: tuple[str, ...]


def read_trace(chart: Chart, trace: np.ndarray) -> list[Reaction]:
    """What the value of a ``trace`` port says: the reactions of the last update, in order."""
    reactions = []
    source = chart.leaves[int(trace[_BEFORE])]
    for fired, leaf in zip(trace[_FIRED], trace[_AFTER], strict=True):
        if fired < 0:
            break
        transition, target = chart.transitions[int(fired)], chart.leaves[int(leaf)]
        exited, entered = tuple(chart.exited(source, transition)), tuple(chart.entered(target, transition))
        reactions.append(Reaction(float(trace[_TIME]), transition.id, source, target, exited, entered))
        source = target
    return reactions


class StatechartSystem(LeafSystem):
    """Runs a compiled chart: one update reacts until nothing more is enabled, so zero-time chains take no time.

    Inputs:
        One (1) for each input that the chart declares, by its name. One that is not connected has the value that the
        chart declares. The decision, if the chart asks for any (``pace:decision``), is read inside the update alone,
        once, in a state that asks; a value that is not finite is no answer.

    Outputs:
        One (1) for each output that the chart declares, by its name: a function of the state and the parameters.
        mode (1): index of the active leaf state in ``chart.leaves``.
        finished (1): 1 in a final state.
        decision_pending (1): only of a chart that asks for decisions: 1 if an update now would come to one. Depends on
            state, time and the inputs other than the decision, so who answers it sees what a policy in the diagram
            sees.
        next_event_time (1) [s]: when a timed guard of the active state may become true; inf if none will.
        trace (2 + 2 * MAX_CHAIN): what the last update did; ``read_trace`` reads it.

    State:
        One numeric vector: x of the chart, then the trace. All of it is in the Context: clones, resets and replays are
        exact.

    Parameters:
        Numeric vector p of the chart.

    Events:
        update: reacts to rest (forced or periodic).

    Args:
        compiled: the chart.
        parameters: values for p, as ``compiled.parameters(...)`` gives them; None: the chart's own.
        initial_state: x before the first reaction, as ``compiled.initial_state(...)`` gives it; None: the chart's own.
        reaction_period: [s]; None: only when forced.
        port_names: input of the chart -> name of its port, where they differ.

    Raises:
        InputError: an output of the chart has the name of one of the system's own.
    """

    def __init__(
        self,
        compiled: CompiledChart,
        parameters: np.ndarray | None = None,
        initial_state: np.ndarray | None = None,
        reaction_period: float | None = None,
        port_names: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__()
        chart = compiled.chart
        self.set_name(chart.name)
        if taken := set(chart.outputs).intersection(_OWN_OUTPUTS):
            raise InputError(f"{chart.path}: output {taken.pop()!r} has the name of a port of its own; rename it")
        self._compiled = compiled
        x = compiled.initial_state() if initial_state is None else initial_state
        self._num_x = len(x)
        trace = np.full(TRACE_SIZE, -1.0)
        trace[_TIME], trace[_BEFORE] = 0.0, x[0]
        self.DeclareDiscreteState(np.concatenate([x, trace]))
        self._p = self.DeclareNumericParameter(BasicVector(compiled.parameters() if parameters is None else parameters))
        ports = {name: declare_input(self, (port_names or {}).get(name, name)) for name in chart.inputs}
        self._decision: InputPort | None = None
        self._absent = 0.0
        if chart.decision is not None:
            self._decision, self._absent = ports.pop(chart.decision), chart.inputs[chart.decision]
        self._inputs: list[tuple[int, InputPort]] = [(compiled.input_index[n], port) for n, port in ports.items()]
        self._defaults = compiled.inputs()
        self._decides = [chart.states[leaf].decision is not None for leaf in chart.leaves]
        self._final = [any(chart.states[state].final for state in chart.ancestors(leaf)) for leaf in chart.leaves]

        stored = {self.xd_ticket()}
        valued = {self.xd_ticket(), self.all_parameters_ticket()}
        timed = {*valued, self.time_ticket()}
        read = {self.input_port_ticket(port.get_index()) for _, port in self._inputs}
        for name, place in compiled.output_index.items():
            declare_output(self, name, partial(self._output, place), valued)
        declare_output(self, "mode", lambda context: self._state(context)[0], stored)
        declare_output(self, "finished", lambda context: self._final[int(self._state(context)[0])], stored)
        if self._decision is not None:
            declare_output(self, "decision_pending", self._decision_pending, timed | read)
        declare_output(self, "next_event_time", self._next_event_time, timed)
        declare_output(self, "trace", lambda context: self._state(context)[self._num_x :], stored, size=TRACE_SIZE)
        declare_update(self, self._update, reaction_period)

    @property
    def compiled(self) -> CompiledChart:
        """The chart that runs."""
        return self._compiled

    def chart_state(self, context: Context) -> np.ndarray:
        """A copy of x, the chart's part of the state."""
        return self._state(context)[: self._num_x].copy()

    def reactions(self, context: Context) -> list[Reaction]:
        """What the last update did, in order."""
        return read_trace(self._compiled.chart, self._state(context)[self._num_x :])

    def fired(self, context: Context) -> list[str]:
        """Ids of the transitions that the last update took, in order."""
        return [reaction.transition for reaction in self.reactions(context)]

    def _answer(self, context: Context) -> float | None:
        """The decision on its port; None: no answer."""
        assert self._decision is not None
        if not self._decision.HasValue(context):
            return None
        value = self._decision.Eval(context)[0]
        return value if isfinite(value) else None

    def _state(self, context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _parameters(self, context: Context) -> list[float]:
        return context.get_numeric_parameter(self._p).value().tolist()

    def _output(self, place: int, context: Context) -> float:
        return self._compiled.outputs(self._state(context), self._parameters(context))[place]

    def _chain(self, context: Context, decide: bool) -> tuple[list[float], list[int], list[int]]:
        """Reacts to rest; with ``decide`` False the decision stays open."""
        # Lists: reading and copying one is several times faster than a small array.
        x = self._state(context)[: self._num_x].tolist()
        u = self._defaults.tolist()
        for place, port in self._inputs:
            if port.HasValue(context):
                u[place] = port.Eval(context)[0]

        def answer() -> float:
            value = self._answer(context)
            return self._absent if value is None else value

        return self._compiled.react_to_rest(
            x,
            u,
            self._parameters(context),
            context.get_time(),
            answer if decide and self._decision is not None else None,
        )

    def _decision_pending(self, context: Context) -> float:
        x, _, _ = self._chain(context, decide=False)
        return float(self._decides[int(x[0])])

    def _next_event_time(self, context: Context) -> float:
        x = self._state(context)[: self._num_x]
        return self._compiled.next_deadline(x, self._defaults, self._parameters(context), context.get_time())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        x, fired, leaves = self._chain(context, decide=True)
        trace = np.full(TRACE_SIZE, -1.0)
        trace[_TIME], trace[_BEFORE] = context.get_time(), self._state(context)[0]
        trace[_FIRED.start : _FIRED.start + len(fired)] = fired
        trace[_AFTER.start : _AFTER.start + len(leaves)] = leaves
        values.set_value(np.concatenate([x, trace]))

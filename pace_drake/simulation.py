"""Simulation: advances an Assembly from event to event, each at its exact time."""

from collections.abc import Callable
from enum import Enum
from math import ceil, floor, inf

import numpy as np
from pydrake.systems.analysis import Simulator, SimulatorStatus
from pydrake.systems.framework import Context, EventStatus

from pace_drake.diagram import Assembly
from pace_drake.stations.layout import Layout, sample_layout
from pace_drake.task import Episode


class Stop(Enum):
    """Why ``Simulation.advance`` came back."""

    DECISION = "decision"
    FINISHED = "finished"
    BOUNDARY = "boundary"


#: A share of a period: from a multiple, the next one is a whole period away.
_ROUNDING = 1e-6

#: [-] speed scale under which the robot is held rather than slowed; near a hand that rests it may creep on for long.
_HELD = 0.05

#: Called as ``listener(simulation, before)`` right before (True) and right after (False) the updates of an event.
Listener = Callable[["Simulation", bool], None]


class Simulation:
    """Drives Drake's Simulator so that the collaboration reacts at the exact times of its events.

    The human, the robot action and the chart say when something changes next (``next_event_time``); the Simulator
    advances to the earliest of these and the reactive systems update there, in order. Between events only periodic
    systems step (plant, safety monitor), and the phase estimator takes one sample of the hand per period of the
    tracker, as long as there is a phase to estimate. This costs one ``AdvanceTo`` per event and sample, where a
    periodic tick fine enough for the same exactness would cost thousands.

    At an event the inputs of the chart are evaluated before anything updates. ``advance`` stops there if a decision is
    asked for and the assembly has no policy, so an adapter sees exactly what a policy inside the diagram sees.

    A safety monitor may lead a motion to another pace, so that it ends at another time than was foretold, and its stop
    is an event: an advance ends within a step of that, and what happens next is foretold anew.

    On hardware anything may happen at any time: there ``keep_up`` follows the clock and reacts at every multiple of a
    period. With the same period, ``advance`` sees an event at the next multiple, so that both react at the same times.

    Args:
        assembly: built with ``reaction_period=None``.
        listeners: observers, such as an event log; they must not change the context.
        period: [s] at whose multiples events are seen; None: at their exact times.

    Raises:
        ValueError: the assembly reacts periodically; any Simulator advances it.
    """

    def __init__(self, assembly: Assembly, listeners: tuple[Listener, ...] = (), period: float | None = None) -> None:
        if assembly.reaction_period is not None:
            raise ValueError("Simulation needs an assembly built with reaction_period=None; use Drake's Simulator")
        self.assembly = assembly
        self.period = period
        self.simulator = Simulator(assembly)
        self.context: Context = self.simulator.get_mutable_context()
        self.listeners = listeners
        self.num_decisions = 0
        self.truncation: str | None = None
        """Why the last ``run`` was truncated; None if it was not."""
        self._begin = 0.0
        self._external = assembly.decision is None
        self._reactive = [
            (system, system.GetMyMutableContextFromRoot(self.context), system.AllocateDiscreteVariables())
            for system in assembly.reactive
        ]
        self._clocks = [
            (system.GetOutputPort("next_event_time"), system.GetMyContextFromRoot(self.context))
            for system in assembly.reactive
            if system.HasOutputPort("next_event_time")
        ]
        self._estimator = assembly.phase_estimator
        self._estimator_context = self._estimator.GetMyMutableContextFromRoot(self.context)
        chart = assembly.task_statechart
        self._chart_context = chart.GetMyContextFromRoot(self.context)
        self._pending_port = chart.GetOutputPort("decision_pending")
        self._finished_port = chart.GetOutputPort("finished")
        self._index_port = chart.GetOutputPort("decision_index")
        self._assist_port = assembly.GetInputPort("assist") if self._external else None
        self._at_event = True
        self._asked = False
        self._robot_context = assembly.robot_action.GetMyContextFromRoot(self.context)
        self._seen_latch: list[bool] = []
        self._foretold = 0.0
        self._monitors = [
            (monitor, monitor.GetMyContextFromRoot(self.context))
            for monitor in (assembly.safety_monitor, assembly.grasp_monitor)
            if monitor is not None
        ]
        if self._monitors:
            self.simulator.set_monitor(self._watch)

    @property
    def time(self) -> float:
        """[s] simulated."""
        return self.context.get_time()

    @property
    def finished(self) -> bool:
        """Whether the last joint action is over and the robot is home."""
        return bool(self._finished_port.Eval(self._chart_context)[0])

    @property
    def decision_pending(self) -> bool:
        """Whether an update now would come to a decision."""
        return bool(self._pending_port.Eval(self._chart_context)[0])

    def output(self, name: str) -> np.ndarray:
        """Value of one of the assembly's exported vector outputs."""
        return self.assembly.GetOutputPort(name).Eval(self.context)

    def sample_episode(self, rng: np.random.Generator) -> Episode:
        """Draws an episode of the assembly's people and task."""
        return self.assembly.people.sample(self.assembly.scenario, rng)

    def sample_layout(self, rng: np.random.Generator) -> Layout:
        """Draws where the components lie."""
        return sample_layout(self.assembly.scenario.workcell, rng)

    def reset(self, episode: Episode, layout: Layout | None = None, time: float = 0.0) -> None:
        """Starts an episode; of the one before, only inputs fixed from outside (stop, ack) are left.

        Args:
            episode: what was drawn of people and durations.
            layout: where the components lie; only with a plant, and there the middle of their zones by default.
            time: [s] at which it starts.
        """
        self.assembly.SetDefaultContext(self.context)
        self.context.SetTime(time)
        self.assembly.set_episode(self.context, episode)
        if layout is not None:
            self.assembly.set_layout(self.context, layout)
        if self._assist_port is not None:
            self._assist_port.FixValue(self.context, -1.0)
        for sink in self.assembly.plant_log.values():
            sink.FindMutableLog(self.context).Clear()
        self.simulator.Initialize()
        self.num_decisions = 0
        self._begin, self.truncation = time, None
        self._at_event, self._asked = True, False

    def decide(self, assist: int) -> None:
        """Answers a pending decision; takes effect when ``advance`` goes on."""
        assert self._assist_port is not None, "the policy inside the diagram decides"
        self._assist_port.FixValue(self.context, float(assist))

    def next_event_time(self) -> float:
        """[s] of the next event; inf if nothing will happen by itself."""
        return min(port.Eval(context)[0] for port, context in self._clocks)

    def interrupt(self) -> None:
        """Lets the collaboration react now: an input from outside (stop, fault, ack) has changed."""
        self._at_event = True

    def advance(self, boundary: float = inf) -> Stop:
        """Advances until a decision must be answered, the episode is finished, or ``boundary`` [s] is reached.

        Called again after DECISION, it first carries the answer out.

        Raises:
            RuntimeError: nothing will ever happen again, and no boundary was given.
        """
        while True:
            if not self._at_event:
                if self.finished:
                    return Stop.FINISHED
                time = self._seen_at(self.next_event_time())
                target = min(time, boundary)
                if target == inf:
                    raise RuntimeError(f"nothing will happen after t = {self.time} s; give a boundary")
                self._foretold = self._led()
                self._advance_to(target)
                if self.time < target:  # a monitor intervened
                    self._at_event = self._latched() != self._seen_latch
                    if not self._at_event:
                        continue
                elif time > boundary:
                    return Stop.BOUNDARY
                else:
                    self._at_event = True
            if self._external and not self._asked and self.decision_pending:
                self._asked = True
                return Stop.DECISION
            self._react()

    def keep_up(self, time: float, begin: Callable[[], None] = lambda: None) -> None:
        """Advances to ``time`` [s], and reacts at every multiple of the period on the way.

        Args:
            time: not before the present.
            begin: called right before each of these reactions; it may change the context.
        """
        assert self.period is not None, "a Simulation that keeps up needs a period"
        self.simulator.clear_monitor()
        if self._at_event:
            self._react()
        while (tick := (floor(self.time / self.period + _ROUNDING) + 1) * self.period) <= time:
            self._advance_to(tick)
            begin()
            self._react()
        self._advance_to(time)

    def _advance_to(self, time: float) -> None:
        """Advances to ``time`` [s]; the phase estimator takes the samples on the way, those of this instant among them.

        As with Drake's periodic events, a sample at ``time`` itself is the next call's. A monitor may end it early.
        """
        estimator, context = self._estimator, self._estimator_context
        period = estimator.sample_period
        number = _first_multiple(self.time, period)
        idle = number * period < time and estimator.idle(context)
        while (due := number * period) < time:
            if idle:
                # Until something happens.
                number = max(number + 1, _first_multiple(min(time, self.next_event_time()), period))
                idle = False
                continue
            if self.time < due:
                status = self.simulator.AdvanceTo(due)
                if status.reason() != SimulatorStatus.ReturnReason.kReachedBoundaryTime:
                    return
            idle = not estimator.take_sample(context)
            number += 1
        self.simulator.AdvanceTo(time)

    def _seen_at(self, time: float) -> float:
        """[s] at which an event of ``time`` [s] is seen."""
        if self.period is None or time == inf:
            return time
        # An event a hair behind a multiple is seen at the next one, as by who keeps up.
        return _first_multiple(time, self.period) * self.period

    def run(
        self,
        max_decisions: int | None = None,
        max_time: float | None = None,
        observe: Callable[[], None] | None = None,
        period: float = 10.0,
    ) -> bool:
        """Runs the episode with the policy inside the diagram.

        Args:
            max_decisions: truncates; None takes the scenario's.
            max_time: [s] from the episode's start, truncates; None takes the scenario's.
            observe: called every ``period``, and once more at the end; it must not change the context.
            period: [s] also between looks at the number of decisions.

        Returns:
            True if it finished, False if it was truncated; ``truncation`` then says why.
        """
        scenario = self.assembly.scenario
        limit = scenario.max_decisions if max_decisions is None else max_decisions
        longest = scenario.max_time if max_time is None else max_time
        end, free = self._begin + longest, self.time
        while self.num_decisions <= limit:
            stop = self.advance(min(self.time + period, end))
            if observe is not None:
                observe()
            if stop == Stop.FINISHED:
                return True
            if not self._held():
                free = self.time
            if self.time >= end:
                self.truncation = f"after {longest:g} s"
                if free < self.time:
                    who = "stopped, waiting for ack," if any(self._latched()) else "held by the hand"
                    self.truncation += f"; the robot was {who} for the last {self.time - free:.0f} s"
                    if lost := self.assembly.describe_loss(self.context):
                        self.truncation += f": {lost}"
                return False
        self.truncation = f"after {limit} decisions"
        return False

    def _held(self) -> bool:
        """Whether a monitor keeps the robot where it is."""
        scaled = self.assembly.safety_monitor is not None and bool(self.output("speed_scale")[0] < _HELD)
        return scaled or any(self._latched())

    def _led(self) -> float:
        """[s] when the safety monitor last led the motion to another pace, or a motion began."""
        return self.assembly.robot_action.clock_time(self._robot_context)

    def _latched(self) -> list[bool]:
        """Which monitors have latched."""
        return [monitor.latched(context) for monitor, context in self._monitors]

    def _watch(self, _: Context) -> EventStatus:
        """Ends an advance early when what was foretold does not hold any more."""
        if self._latched() != self._seen_latch or self._led() != self._foretold:
            return EventStatus.ReachedTermination(self.assembly, "a monitor intervened")
        return EventStatus.DidNothing()

    def _react(self) -> None:
        """Updates the reactive systems at the present instant."""
        for listener in self.listeners:
            listener(self, True)
        for system, context, values in self._reactive:
            values.SetFrom(context.get_discrete_state())
            system.CalcForcedDiscreteVariableUpdate(context, values)
            context.SetDiscreteState(values)
            if system is self.assembly.task_statechart:
                self.assembly.refill_pile(self.context)
        self._seen_latch = self._latched()
        self.num_decisions = int(self._index_port.Eval(self._chart_context)[0])
        self._at_event = self._asked = False
        for listener in self.listeners:
            listener(self, False)


def _first_multiple(time: float, period: float) -> int:
    """The least k with k * period >= time, as products round."""
    k = ceil(time / period)
    while k * period < time:
        k += 1
    while (k - 1) * period >= time:
        k -= 1
    return k

"""The diagram at the task level: exact events, closed forms, repeatability."""

from dataclasses import replace

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.errors import InputError
from pace_drake.evaluate.event_log import EventRecorder
from pace_drake.people import People
from pace_drake.policies import Policy
from pace_drake.policies.factory import make_policy
from pace_drake.policies.rules import AlwaysAssist
from pace_drake.scenario import Scenario
from pace_drake.simulation import Simulation, Stop
from pace_drake.systems.phase_estimator import PhaseEstimator
from pace_drake.task import Assistance, Duration, HumanAction, RobotTask, Task
from tests.naive import naive_episode


@pytest.fixture(scope="module")
def chair_simulation(chair, chair_people):
    """Decisions come from outside."""
    return Simulation(Assembly(chair, people=chair_people))


class Nameless(Policy):
    def decide_all(self, observations):
        return np.ones(len(observations))


class Unknown(Nameless):
    observation = "all"


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (
            lambda observation: 1,
            "policy: subclass pace_drake.policies.Policy, with observation .*; <function .* is none",
        ),
        (AlwaysAssist, "policy: subclass .* is none"),  # the class itself
        (Nameless(), "Nameless.observation: must be one of none, paper, fused, history, is ''"),
        (Unknown(), "Unknown.observation: must be one of none, paper, fused, history, is 'all'"),
    ],
)
def test_what_is_no_policy_is_told_how_to_be_one(chair, chair_people, policy, message):
    with pytest.raises(InputError, match=message):
        Assembly(chair, policy, people=chair_people)


def run_with(simulation, episode, decisions):
    """Runs an episode with given decisions; returns idle times (2, L), decision times, whether it finished."""
    simulation.reset(episode)
    times = []
    while True:
        stop = simulation.advance()
        if stop == Stop.FINISHED or len(times) == len(decisions):
            break
        assert stop == Stop.DECISION
        assert simulation.decision_pending
        times.append(simulation.time)
        simulation.decide(decisions[len(times) - 1])
    idle = np.array([simulation.output("robot_idle"), simulation.output("human_idle")])
    return idle, times, stop == Stop.FINISHED


def compare(simulation, num_episodes, seed):
    task = simulation.assembly.scenario.task
    limit = 60
    for k in range(num_episodes):
        rng = np.random.default_rng([seed, k])
        episode = simulation.sample_episode(rng)
        decisions = (rng.random(limit) < rng.random()).astype(int)
        idle, times, finished = run_with(simulation, episode, decisions)
        robot, human, expected_times, expected_finished = naive_episode(
            task, episode, lambda n, d=decisions: d[n], max_decisions=limit
        )
        assert finished == expected_finished
        np.testing.assert_allclose(times, expected_times, rtol=0, atol=1e-9)
        if finished:
            np.testing.assert_allclose(idle, [robot, human], rtol=0, atol=1e-9)
            cost = robot.sum() + task.human_idle_weight * human.sum()
            assert simulation.output("cost")[0] == pytest.approx(cost, abs=1e-8)


def test_idle_times_equal_the_closed_forms_of_the_chair(chair, chair_people):
    """1,000 random episodes with random decisions; see naive_episode and docs/departures.md.

    Idle times do not depend on the phase when decisions come from outside, so the estimator is left out for speed.
    """
    blind = replace(chair_people, references=[None] * chair.task.num_human_actions, description="no estimator")
    compare(Simulation(Assembly(chair, people=blind)), 1000, seed=1)


def random_task(rng) -> Task:
    def duration(mean):
        return Duration(mean=mean * rng.uniform(0.3, 2.0), cv=rng.choice([0.0, 0.3]), minimum=0.1)

    actions, joint = [], False
    for k in range(rng.integers(1, 7)):
        joint = not joint and rng.random() < 0.6
        assistance = Assistance(preparation=duration(6), homing=duration(6)) if joint else None
        actions.append(HumanAction(name=f"h{k}", duration=duration(10), assistance=assistance))
    if not joint:
        actions.append(HumanAction(name="last", duration=duration(10), assistance=Assistance()))
    robot_tasks = [RobotTask(name=f"r{k}", duration=duration(6)) for k in range(rng.integers(1, 5))]
    return Task(human_actions=actions, robot_tasks=robot_tasks)


def test_idle_times_equal_the_closed_forms_of_random_tasks():
    """Any order of joint actions, several actions between them, a joint action first, one robot task, ..."""
    for k in range(20):
        task = random_task(np.random.default_rng(k))
        n = task.num_human_actions
        scenario = Scenario(name="random", task=task)
        scenario.validate()
        people = People([[] for _ in range(n)], [None] * n, [[] for _ in range(n)], True, "nobody")
        compare(Simulation(Assembly(scenario, people=people)), 10, seed=k)


def test_the_first_decision_is_asked_at_time_zero(chair_simulation):
    chair_simulation.reset(chair_simulation.sample_episode(np.random.default_rng(0)))
    assert chair_simulation.advance() == Stop.DECISION
    assert chair_simulation.time == 0.0
    assert list(chair_simulation.output("observation")) == [4, 1, 0, 0]


def test_an_unanswered_decision_times_out_and_the_robot_goes_on(chair_simulation):
    chair_simulation.reset(chair_simulation.sample_episode(np.random.default_rng(0)))
    assert chair_simulation.advance() == Stop.DECISION
    chair_simulation.decide(-1)
    assert chair_simulation.advance(boundary=0.5) == Stop.BOUNDARY
    assert chair_simulation.output("mode")[0] == 2  # DECIDE
    assert chair_simulation.advance(boundary=1.5) == Stop.DECISION or chair_simulation.time == 1.5
    chair_simulation.decide(-1)
    chair_simulation.advance(boundary=1.5)
    assert chair_simulation.output("mode")[0] == 1  # ROBOT_TASK
    assert chair_simulation.output("robot_task")[0] == 1


def test_a_boundary_between_events_is_kept_exactly_and_changes_nothing(chair_simulation):
    episode = chair_simulation.sample_episode(np.random.default_rng(3))
    decisions = [0, 0, 1, 0, 1] + [0, 0, 1] * 10
    idle, times, finished = run_with(chair_simulation, episode, decisions)
    assert finished
    chair_simulation.reset(episode)
    seen = []
    boundary = 0.0
    while True:
        boundary += 0.37
        stop = chair_simulation.advance(boundary)
        if stop == Stop.BOUNDARY:
            assert chair_simulation.time == boundary
        elif stop == Stop.DECISION:
            seen.append(chair_simulation.time)
            chair_simulation.decide(decisions[len(seen) - 1])
        else:
            break
    assert seen == times
    assert np.array_equal(idle[0], chair_simulation.output("robot_idle"))


class Trace:
    """A listener that keeps everything the statechart and the policy see."""

    def __init__(self):
        self.rows = []

    def __call__(self, simulation, before):
        chart = simulation.assembly.task_statechart
        context = chart.GetMyContextFromRoot(simulation.context)
        self.rows.append(
            (
                before,
                simulation.time,
                *context.get_discrete_state_vector().value(),
                *simulation.output("observation"),
                *simulation.output("robot_idle"),
                *simulation.output("human_idle"),
            )
        )


def test_same_seed_same_trace_and_policy_inside_equals_adapter(chair, chair_people, chair_simulation):
    policy = make_policy("phase_threshold", chair)
    inside = Simulation(Assembly(chair, policy, people=chair_people))
    traces = []
    for simulation in (inside, inside, chair_simulation, chair_simulation):
        trace = Trace()
        simulation.listeners = (trace,)
        for seed in (5, 6):
            simulation.reset(simulation.sample_episode(np.random.default_rng(seed)))
            while (stop := simulation.advance(simulation.time + 50.0)) != Stop.FINISHED:
                if stop == Stop.DECISION:
                    simulation.decide(policy.decide(simulation.output("observation")))
        simulation.listeners = ()
        traces.append(trace.rows)
    assert len(traces[0]) > 50
    assert traces[0] == traces[1]  # two resets, same episode
    assert traces[2] == traces[3]
    assert traces[0] == traces[2]  # bit for bit
    assert chair_simulation.num_decisions == inside.num_decisions


def test_the_context_holds_everything(chair_simulation):
    """A copy of the context in the middle of an episode continues bit for bit as the original did."""
    simulation = chair_simulation
    simulation.reset(simulation.sample_episode(np.random.default_rng(9)))
    decisions = iter([0, 0, 1] + [0, 0, 1] * 20)
    for _ in range(4):
        simulation.advance()
        simulation.decide(next(decisions))
    simulation.advance(simulation.time + 2.0)
    saved = simulation.context.Clone()
    rest = list(decisions)

    def finish():
        times, phases = [], []
        for decision in rest:
            if simulation.advance() == Stop.FINISHED:
                break
            times.append(simulation.time)
            phases.append(simulation.output("phase")[0])
            simulation.decide(decision)
        return times, phases, *simulation.output("robot_idle"), *simulation.output("human_idle")

    first = finish()
    assert any(0.0 < phase < 1.0 for phase in first[1])
    simulation.context.SetTimeStateAndParametersFrom(saved)
    simulation.simulator.Initialize()
    assert finish() == first


def sample_times(simulation, drive, episode, time=0.0):
    """Times at which the phase estimator took a sample in an action with an estimator, and the phases after each."""
    estimator = simulation.assembly.phase_estimator
    seen = []

    def take_sample(context):
        at_work = PhaseEstimator.take_sample(estimator, context)
        if at_work:
            seen.append((context.get_time(), estimator.GetOutputPort("phase").Eval(context)[0]))
        return at_work

    estimator.take_sample = take_sample
    try:
        simulation.reset(episode, time=time)
        drive(simulation)
    finally:
        del estimator.take_sample
    return seen


@pytest.mark.parametrize("begin", [0.0, 4.7, 4.75])
def test_a_sample_is_taken_at_each_period_of_the_tracker_while_there_is_a_phase_to_estimate(chair, chair_people, begin):
    simulation = Simulation(Assembly(chair, make_policy("phase_threshold", chair), people=chair_people))
    episode = simulation.sample_episode(np.random.default_rng(3))
    spans = []

    def look(simulation, before):
        if not before:
            spans.append((simulation.time, chair.task.human_actions[int(simulation.output("human_action")[0]) - 1]))

    simulation.listeners = (look,)
    seen = sample_times(simulation, lambda simulation: simulation.run(), episode, begin)
    end = simulation.time
    expected = []
    for (start, action), (stop, _) in zip(spans, [*spans[1:], (end, None)], strict=True):
        ticks = 0.1 * np.arange(int(start / 0.1) - 1, int(stop / 0.1) + 2)
        expected += [] if action.joint else list(ticks[(ticks >= start) & (ticks < stop)])
    assert len(expected) > 300
    assert [time for time, _ in seen] == sorted(set(expected))


def test_where_an_advance_ends_changes_no_sample(chair, chair_people):
    simulation = Simulation(Assembly(chair, make_policy("phase_threshold", chair), people=chair_people))
    episode = simulation.sample_episode(np.random.default_rng(3))

    def by_steps(steps):
        def drive(simulation):
            while simulation.advance(simulation.time + next(steps)) != Stop.FINISHED:
                pass

        return sample_times(simulation, drive, episode)

    whole = by_steps(iter(lambda: np.inf, 0))
    rng = np.random.default_rng(0)
    assert len(whole) > 300
    assert by_steps(iter(lambda: rng.uniform(0.01, 0.3), 0)) == whole
    assert by_steps(iter(lambda: 0.1, 0)) == whole  # up to rounding, each ends at a sample
    assert by_steps(iter(lambda: 0.05, 0)) == whole


def test_explicit_query_has_no_robot_idle_and_costs_about_what_the_paper_measured(chair, chair_people):
    simulation = Simulation(Assembly(chair, make_policy("explicit_query", chair), people=chair_people))
    costs = []
    for seed in range(100):
        simulation.reset(simulation.sample_episode(np.random.default_rng(seed)))
        assert simulation.run()
        assert np.all(simulation.output("robot_idle") == 0)
        costs.append(simulation.output("cost")[0])
    assert 110 < np.mean(costs) < 130  # notes: 120.4; the paper's people 112.3


def test_never_assisting_is_truncated(chair, chair_people):
    simulation = Simulation(Assembly(chair, make_policy("never_assist", chair), people=chair_people))
    simulation.reset(simulation.sample_episode(np.random.default_rng(0)))
    assert simulation.run(max_decisions=20) is False
    assert not simulation.finished
    assert simulation.truncation == "after 20 decisions"


def test_an_episode_is_truncated_after_so_much_simulated_time(chair, chair_people):
    scenario = replace(chair, max_time=50.0)
    simulation = Simulation(Assembly(scenario, make_policy("never_assist", chair), people=chair_people))
    episode = simulation.sample_episode(np.random.default_rng(0))
    for begin, limit in ((0.0, None), (7.0, None), (7.0, 31.5)):
        simulation.reset(episode, time=begin)
        assert simulation.run(max_time=limit) is False
        assert simulation.time == begin + (limit or 50.0)
        assert simulation.truncation == f"after {limit or 50:g} s"
        assert not simulation.finished
    simulation.reset(episode)
    assert simulation.truncation is None


def test_an_episode_that_finishes_was_not_truncated(chair, chair_people):
    simulation = Simulation(Assembly(chair, make_policy("phase_threshold", chair), people=chair_people))
    simulation.reset(simulation.sample_episode(np.random.default_rng(0)))
    assert simulation.run()
    assert simulation.truncation is None


def test_stop_holds_the_robot_and_acknowledgement_resumes_the_same_task(chair, chair_people):
    """The operator's inputs reach the chart; the interrupted robot task takes its whole time, plus the stop."""
    simulation = Simulation(Assembly(chair, make_policy("never_assist", chair), people=chair_people))
    assembly, context = simulation.assembly, simulation.context
    episode = simulation.sample_episode(np.random.default_rng(0))
    simulation.reset(episode)
    first = episode.robot[0, 0]
    simulation.advance(3.0)
    for stop, ack, until in ((1.0, 0.0, 10.0), (0.0, 1.0, 10.5), (0.0, 0.0, 11.0)):
        assembly.GetInputPort("stop").FixValue(context, stop)
        assembly.GetInputPort("ack").FixValue(context, ack)
        simulation.interrupt()
        simulation.advance(until)
        assert (simulation.output("mode")[0] == 7) == (stop == 1.0)  # STOPPED
    assert simulation.output("robot_task")[0] == 1
    simulation.advance(first + 7.0 - 1e-6)
    assert simulation.output("robot_task")[0] == 1
    simulation.advance(first + 7.0 + 1e-6)
    assert simulation.output("robot_task")[0] == 2


def test_a_periodic_assembly_runs_in_any_simulator_and_agrees_to_its_period(chair, chair_people, chair_simulation):
    from pydrake.systems.analysis import Simulator

    period = 0.01
    policy = make_policy("elapsed_threshold", chair)
    assembly = Assembly(chair, policy, people=chair_people, reaction_period=period)
    simulator = Simulator(assembly)
    context = simulator.get_mutable_context()
    episode = chair_simulation.sample_episode(np.random.default_rng(2))
    assembly.set_episode(context, episode)
    simulator.Initialize()
    exact = Simulation(Assembly(chair, policy, people=chair_people))
    exact.reset(episode)
    exact.run()
    simulator.AdvanceTo(exact.time + 2.0)
    assert assembly.GetOutputPort("finished").Eval(context)[0] == 1
    for name in ("robot_idle", "human_idle"):
        np.testing.assert_allclose(
            assembly.GetOutputPort(name).Eval(context), exact.output(name), atol=20 * period, rtol=0
        )


def test_event_driven_and_periodic_assemblies_are_not_mixed_up(chair, chair_people):
    with pytest.raises(ValueError, match="reaction_period=None"):
        Simulation(Assembly(chair, people=chair_people, reaction_period=0.01))


def recorded(simulation, drive, episode, time=0.0):
    """Rows of an episode whose course ``drive(simulation)`` leads."""
    rows = []
    simulation.listeners = (EventRecorder(lambda time, kind, **values: rows.append((time, kind, values))),)
    simulation.reset(episode, time=time)
    drive(simulation)
    return rows


def follow_the_clock(longest):
    """Leads an episode to its end by steps of random length, up to ``longest`` [s]."""

    def drive(simulation):
        rng = np.random.default_rng(0)
        while not simulation.finished:
            simulation.keep_up(simulation.time + rng.uniform(0.001, longest))

    return drive


def test_what_keeps_up_with_a_clock_reacts_when_what_foretells_does(chair, chair_people):
    """To the bit, though one reacts a hundred times a second and the other at events only."""
    simulation = Simulation(Assembly(chair, make_policy("phase_threshold", chair), people=chair_people), period=0.01)
    episode = simulation.sample_episode(np.random.default_rng(3))

    foretold = recorded(simulation, lambda simulation: simulation.run(), episode, time=4.7)
    followed = recorded(simulation, follow_the_clock(0.03), episode, time=4.7)
    assert len(foretold) > 40
    assert foretold == followed
    reactions = np.array([time for time, kind, _ in foretold if kind == "reaction"])
    np.testing.assert_allclose(reactions, np.round(reactions, 2), atol=1e-9)
    assert reactions[0] == pytest.approx(4.7)


def test_samples_do_not_wait_for_an_event_to_be_seen(chair, chair_people):
    """The person is at work before that shows in a reaction, and who looks more often takes no other samples."""
    simulation = Simulation(Assembly(chair, make_policy("phase_threshold", chair), people=chair_people), period=0.25)
    episode = simulation.sample_episode(np.random.default_rng(3))

    foretold = sample_times(simulation, lambda simulation: simulation.run(), episode)
    followed = sample_times(simulation, follow_the_clock(0.3), episode)
    assert len(foretold) > 300
    assert foretold == followed[: len(foretold)]


def test_an_event_is_seen_at_the_next_multiple_and_not_before(chair, chair_people):
    simulation = Simulation(Assembly(chair, make_policy("explicit_query", chair), people=chair_people), period=0.5)
    episode = simulation.sample_episode(np.random.default_rng(3))
    rows = recorded(simulation, lambda simulation: simulation.run(), episode)
    first = episode.robot[0, 0]
    assert first % 0.5 != 0.0
    reactions = [time for time, kind, values in rows if kind == "reaction" and values["name"] == "r_done"]
    assert reactions[1] == pytest.approx(np.ceil(first / 0.5) * 0.5)
    np.testing.assert_allclose(np.mod(reactions, 0.5), 0.0, atol=1e-9)


def test_an_event_is_seen_at_the_first_multiple_that_is_not_before_it(chair, chair_people):
    simulation = Simulation(Assembly(chair, people=chair_people), period=0.01)
    for k in range(5000):
        tick = k * 0.01
        assert simulation._seen_at(tick) == tick
        assert simulation._seen_at(np.nextafter(tick, np.inf)) == (k + 1) * 0.01
        assert simulation._seen_at(np.nextafter(tick + 0.005, 0.0)) == (k + 1) * 0.01


def test_keeping_up_needs_a_period(chair_simulation):
    with pytest.raises(AssertionError, match="needs a period"):
        chair_simulation.keep_up(1.0)

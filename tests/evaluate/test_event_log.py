"""EventLog and EventRecorder: rows are on disk as they happen, and say exactly what happened."""

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.evaluate.event_log import EventLog, EventRecorder
from pace_drake.evaluate.timeline import read_events
from pace_drake.policies.factory import make_policy
from pace_drake.simulation import Simulation


def test_a_row_is_on_disk_at_once(tmp_path):
    path = tmp_path / "events.csv"
    log = EventLog(path)
    for k in range(3):
        log.write(0, 0.1 + k, "phase", phase=np.float64(1 / 3))
        rows = read_events(path)  # while the log is open: a kill now would lose nothing
        assert len(rows) == k + 1
        assert float(rows[-1]["time"]) == 0.1 + k
        assert float(rows[-1]["phase"]) == 1 / 3  # exact
    log.close()


def test_a_row_cut_short_by_a_kill_is_left_out(tmp_path):
    path = tmp_path / "events.csv"
    with EventLog(path) as log:
        log.write(0, 1.0, "phase", phase=0.5)
        log.write(0, 2.0, "phase", phase=0.5)
    path.write_bytes(path.read_bytes()[:-12])
    assert [row["time"] for row in read_events(path)] == ["1.0"]


def test_an_existing_log_is_not_overwritten(tmp_path):
    path = tmp_path / "events.csv"
    path.write_text("precious")
    with pytest.raises(FileExistsError):
        EventLog(path)
    assert path.read_text() == "precious"


def test_a_stop_is_logged_and_resuming_names_the_state_it_returns_to(chair, chair_people):
    simulation = Simulation(Assembly(chair, make_policy("always_assist", chair), people=chair_people))
    rows = []
    simulation.listeners = (EventRecorder(lambda t, kind, **v: rows.append((t, kind, v))),)
    simulation.reset(simulation.sample_episode(np.random.default_rng(1)))
    simulation.advance(13.0)  # prepared, and waiting for the person
    for time, stop, ack in ((13.0, 1.0, 0.0), (14.0, 0.0, 1.0)):
        simulation.advance(time)
        for name, value in (("stop", stop), ("ack", ack)):
            simulation.assembly.GetInputPort(name).FixValue(simulation.context, value)
        simulation.interrupt()
    simulation.advance(15.0)
    reactions = [(t, v["name"], v["source"], v["target"]) for t, kind, v in rows if kind == "reaction"]
    assert reactions[-3][1:] == ("p_wait", "PREP", "WAIT")
    assert reactions[-2:] == [(13.0, "t_stop", "WAIT", "STOPPED"), (14.0, "s_resume", "STOPPED", "WAIT")]


def test_a_truncated_episode_accounts_for_the_person_who_still_waits(chair, chair_people):
    from dataclasses import replace

    from pace_drake.evaluate.episode import run_episode

    scenario = replace(chair, max_decisions=10)
    simulation = Simulation(Assembly(scenario, make_policy("never_assist", chair), people=chair_people))
    rows = []
    episode = simulation.sample_episode(np.random.default_rng(0))
    result = run_episode(simulation, episode, lambda t, kind, **v: rows.append((kind, v)))
    assert not result.finished
    assert rows[-1] == ("episode", {"name": "truncated"})
    (waited,) = [v["duration"] for kind, v in rows if kind == "human_idle"]
    assert waited == pytest.approx(result.human_idle[0])
    assert waited > 20


def test_who_arrives_just_in_time_has_not_waited(chair, chair_people):
    """Idle rows are never empty, and none is missing: they add up to the meter's totals."""
    from pace_drake.evaluate.episode import run_episode

    simulation = Simulation(Assembly(chair, make_policy("phase_threshold", chair), people=chair_people))
    for seed in range(5):
        rows = []
        episode = simulation.sample_episode(np.random.default_rng(seed))
        result = run_episode(simulation, episode, lambda t, kind, rows=rows, **v: rows.append((kind, v)))
        for agent in ("robot_idle", "human_idle"):
            durations = [v["duration"] for kind, v in rows if kind == agent]
            assert all(d > 0 for d in durations)
            assert sum(durations) == pytest.approx(sum(getattr(result, agent)), abs=1e-9)

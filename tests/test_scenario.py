"""pace_drake.scenario: typed, validated, errors in one line that names the key."""

import pytest

from pace_drake.errors import InputError
from pace_drake.scenario import Scenario, load_scenario, scenario_names


def test_every_shipped_scenario_loads_and_survives_its_own_yaml(tmp_path):
    assert "ikea_chair" in scenario_names()
    for name in scenario_names():
        scenario = load_scenario(name)
        path = tmp_path / f"{name}.yaml"
        path.write_text(scenario.to_yaml())
        assert load_scenario(str(path)) == scenario


def test_one_of_everything_survives_its_own_yaml(tmp_path):
    overrides = (
        "human.seed=7",
        "human.split=all",
        "statechart=pace_task",
        "decide_at_start=false",
        "decision_timeout=0.5",
        "wait_timeout=30",
        "max_decisions=50",
        "max_time=600",
        "task.robot_tasks.0.duration.distribution=log_normal",
        "workcell.time_step=0.001",
        "lcm.command_rate=250",
    )
    scenario = load_scenario("ikea_chair", overrides)
    assert scenario.task.robot_tasks[0].duration.distribution == "log_normal"
    assert scenario.wait_timeout == 30
    path = tmp_path / "all.yaml"
    path.write_text(scenario.to_yaml())
    assert load_scenario(str(path)) == scenario
    assert scenario != load_scenario("ikea_chair")


def test_overrides_reach_dicts_and_lists():
    scenario = load_scenario(
        "ikea_chair", ("task.human_actions.2.duration.mean=20.5", "estimator.place_rails.gamma=0.7", "policy=never")
    )
    assert scenario.task.human_actions[2].duration.mean == 20.5
    assert scenario.estimator["place_rails"].gamma == 0.7
    assert scenario.policy == "never"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("foo=1", "foo"),
        ("task.foo=1", "cannot set 'task.foo': no such key 'foo'; known are human_actions, "),
        ("task.human_actions.0.duration.meen=1", "meen"),
        ("task.human_actions.9.duration.mean=1", "task.human_actions.9.duration.mean"),
        ("task.human_idle_weight=0", "task.human_idle_weight: lambda must be > 0"),
        ("task.human_idle_weight=-3", "task.human_idle_weight"),
        ("task.human_idle_weight=lots", "task.human_idle_weight: could not convert string to float: 'lots'"),
        ("task.robot_tasks.2.duration.mean=x", "task.robot_tasks.[].duration.mean: could not convert"),
        ("task.human_actions.1.assistance.homing=3", "task.human_actions.[].assistance.homing"),
        ("human.seed=[1]", "human.seed"),
        ("estimator.carry_side.gamma=1", "estimator.carry_side: is not a non-joint human action"),
        ("estimator.place_rails.gamma=-1", "estimator.place_rails.gamma"),
        ("estimator.place_rails.window=0.1", "estimator.place_rails.window: must hold at least 2 samples"),
        ("estimator.place_rails.distance=manhattan", "estimator.place_rails.distance"),
        ("human.split=test", "human.split"),
        ("human.sample_period=0", "human.sample_period"),
        ("human.workplace=[1, 2]", "human.workplace: must be x, y, z"),
        ("max_decisions=0", "max_decisions"),
        ("max_time=0", "max_time: must be > 0"),
        ("decision_timeout=.inf", "decision_timeout"),
        ("phase_threshold.nobody=0.5", "phase_threshold.nobody"),
        ("nonsense", "write key=value"),
    ],
)
def test_errors_are_one_line_and_name_the_key(override, message):
    with pytest.raises(InputError) as error:
        load_scenario("ikea_chair", (override,))
    text = str(error.value)
    assert message in text
    assert "\n" not in text


@pytest.mark.parametrize("content", ["", "- 1\n- 2\n", "a: [", "task: 3", "\x00"])
def test_files_that_are_no_scenario(tmp_path, content):
    path = tmp_path / "bad.yaml"
    path.write_text(content)
    with pytest.raises(InputError) as error:
        load_scenario(str(path))
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_unknown_and_missing():
    with pytest.raises(InputError, match=r"unknown scenario 'nope'; known are .*ikea_chair"):
        load_scenario("nope")
    with pytest.raises(InputError, match=r"absent\.yaml: cannot read the scenario"):
        load_scenario("absent.yaml")
    with pytest.raises(InputError, match="no such file"):
        Scenario(statechart="absent.scxml").chart_path()

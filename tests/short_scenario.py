"""The chair's collaboration in a tenth of its time, for tests whose diagram reacts every 10 ms."""

from pace_drake.scenario import load_scenario


def short_scenario(*overrides):
    scenario = load_scenario("ikea_chair", overrides)
    task = scenario.task
    durations = [action.duration for action in (*task.human_actions, *task.robot_tasks)]
    durations += [d for assistance in task.assistances for d in (assistance.preparation, assistance.homing)]
    for duration in durations:
        duration.mean, duration.minimum = duration.mean / 10, duration.minimum / 10
    scenario.validate()
    return scenario

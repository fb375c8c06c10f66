"""A task that several systems are tested on."""

from pace_drake.task import Assistance, HumanAction, RobotTask, Task


def five_actions():
    """a, b, joint c, d, joint e."""
    joint = Assistance()
    return Task(
        human_actions=[
            HumanAction(name="a"),
            HumanAction(name="b"),
            HumanAction(name="c", assistance=joint),
            HumanAction(name="d"),
            HumanAction(name="e", assistance=joint),
        ],
        robot_tasks=[RobotTask(name="r")],
    )

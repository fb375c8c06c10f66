"""TaskStatechart: runs the chart of the collaboration (PACE, Fig. 2)."""

import numpy as np
from pydrake.systems.framework import Context

from pace_drake.errors import InputError
from pace_drake.ports import declare_output
from pace_drake.statechart import CompiledChart
from pace_drake.systems.statechart import StatechartSystem
from pace_drake.task import ActionKind
from pace_drake.task_chart import check_task_chart

_COMMAND = ("kind", "index", "number")


class TaskStatechart(StatechartSystem):
    """A StatechartSystem whose chart decides about the robot's actions.

    Inputs:
        Those of StatechartSystem. For ``pace_task.scxml``: start, stop, fault, ack (operator), done (motion_done), rb
        (robot_busy), hj (human_joint), nj (joints_done).
        assist (1) in {-1 none yet, 0, 1}: the decision; anything but 0 and 1 is no answer.

    Outputs:
        Those of StatechartSystem, among them, which the chart must declare:
        robot_task (1): i, the last robot task started [1-based].
        joint_action (1): l, the next joint action [1-based].
        joint_ready (1): l while the robot is ready to perform joint action l with the person, else 0.
        robot_waiting (1): l while the robot waits, prepared, for the person, else 0.
        decision_index (1): d, the number of decisions asked for.
        And of its own:
        robot_action (3): kind (``ActionKind``), index (i or l), sequence number of the command.

    Args:
        compiled, parameters, initial_state, reaction_period: see StatechartSystem.

    Raises:
        InputError: the chart lacks something that is ``task_chart.NEEDED``, or gives an action kind another number.
    """

    def __init__(
        self,
        compiled: CompiledChart,
        parameters: np.ndarray | None = None,
        initial_state: np.ndarray | None = None,
        reaction_period: float | None = None,
    ) -> None:
        chart = compiled.chart
        check_task_chart(chart)
        for name, value in chart.constants.items():
            kind = name.removesuffix("_KIND")
            if kind != name and (kind not in ActionKind.__members__ or ActionKind[kind] != value):
                known = ", ".join(f"{k.name}_KIND {k.value}" for k in ActionKind)
                raise InputError(f"{chart.path}: {name} = {value:g} is no action kind; known are {known}")
        super().__init__(compiled, parameters, initial_state, reaction_period, port_names={"a": "assist"})
        self.set_name("task_statechart")
        self._places = [compiled.output_index[name] for name in _COMMAND]
        declare_output(
            self, "robot_action", self._robot_action, {self.xd_ticket(), self.all_parameters_ticket()}, size=3
        )

    def _robot_action(self, context: Context) -> list[float]:
        values = self.compiled.outputs(self._state(context), self._parameters(context))
        return [values[place] for place in self._places]

    def _answer(self, context: Context) -> float | None:
        value = super()._answer(context)
        return value if value in (0.0, 1.0) else None

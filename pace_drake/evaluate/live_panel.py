"""The state of things in Meshcat's own controls, while an episode runs."""

from pydrake.geometry import Meshcat

from pace_drake.simulation import Simulation


class LivePanel:
    """Shows the chart's state, what the person does, the phase and the idle times under Meshcat's "Open Controls".

    Meshcat has no text, only buttons and sliders: figures are sliders that are set, the state is a button without
    effect that is made anew when it changes. Moving them changes nothing.

    Args:
        meshcat: gets the controls.
        longest: [s] upper end of the sliders for idle times and cost; what is longer stands there.
    """

    def __init__(self, meshcat: Meshcat, longest: float = 60.0) -> None:
        self._meshcat = meshcat
        self._state = ""
        meshcat.AddSlider("phase", 0.0, 1.0, 0.01, 0.0)
        for name in ("robot idle [s]", "human idle [s]", "cost [s]"):
            meshcat.AddSlider(name, 0.0, longest, 0.1, 0.0)

    def show(self, simulation: Simulation) -> None:
        """Shows the present state; called now and then."""
        state = self._describe(simulation)
        if state != self._state:
            if self._state:
                self._meshcat.DeleteButton(self._state)
            self._meshcat.AddButton(state)
            self._state = state
        self._meshcat.SetSliderValue("phase", simulation.output("phase")[0])
        self._meshcat.SetSliderValue("robot idle [s]", simulation.output("robot_idle").sum())
        self._meshcat.SetSliderValue("human idle [s]", simulation.output("human_idle").sum())
        self._meshcat.SetSliderValue("cost [s]", simulation.output("cost")[0])

    @staticmethod
    def _describe(simulation: Simulation) -> str:
        chart = simulation.assembly.task_statechart
        context = chart.GetMyContextFromRoot(simulation.context)
        leaf = chart.compiled.leaf(chart.chart_state(context))
        waited = chart.GetOutputPort("robot_waiting").Eval(context)[0]
        number = int(simulation.output("robot_action")[1] or waited)
        action = simulation.assembly.scenario.task.human_actions[int(simulation.output("human_action")[0]) - 1].name
        waits = "waits: " if simulation.output("human_waiting")[0] else ""
        return f"robot: {leaf}{f' {number}' if number else ''}, person: {waits}{action}"

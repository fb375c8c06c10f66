"""Where the parts of a statechart's picture stand; no drawing here.

States stand below each other, states inside states. Each lists its transitions, one row each (``guard / effect``), and
an arrow leads from the row through a lane at the right to the header of the target. So no label can overlap anything,
and the picture of a chart changes only where the chart does.
"""

from dataclasses import dataclass, field

from pace_drake.statechart.model import Chart, Transition

#: [px] sizes; text is set in a monospaced font, so that its width is known without a font.
FONT, CHARACTER, LINE, HEADER, PAD = 12.0, 7.23, 16.0, 24.0, 8.0
_GUTTER, _INSET, _LANE, _GAP = 30.0, 12.0, 9.0, 10.0
_WRAP = 78


@dataclass(frozen=True)
class Text:
    """A line of text; y is its middle."""

    x: float
    y: float
    text: str
    style: str


@dataclass(frozen=True)
class Box:
    """A state: its frame and the texts inside."""

    state: str
    x: float
    y: float
    width: float
    height: float
    is_leaf: bool
    is_final: bool
    decides: bool
    texts: tuple[Text, ...]

    @property
    def right(self) -> float:
        """x of the right border."""
        return self.x + self.width


@dataclass(frozen=True)
class Row:
    """A transition: its text inside the source, and the corners of its arrow (none if it is internal)."""

    transition: Transition
    texts: tuple[Text, ...]
    points: tuple[tuple[float, float], ...]
    color: int


@dataclass(frozen=True)
class Mark:
    """An initial dot with an arrow to a state, or a history circle.

    Attributes:
        history: id of the history; None: an initial dot.
        to: where the arrow of an initial dot ends.
    """

    x: float
    y: float
    history: str | None
    to: tuple[float, float] | None


@dataclass
class Layout:
    """A whole picture."""

    width: float = 0.0
    height: float = 0.0
    boxes: list[Box] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)


def wrapped(text: str, width: int = _WRAP) -> list[str]:
    """Breaks a label after ``&&``, ``||``, ``/`` or ``;``."""
    lines = [""]
    for word in text.split(" "):
        joined = f"{lines[-1]} {word}".strip()
        if len(joined) > width and lines[-1].rstrip().endswith(("&&", "||", "/", ";")):
            lines.append(word)
        else:
            lines[-1] = joined
    return lines


def label(transition: Transition) -> str:
    """``id: guard / effect``."""
    guard = "" if transition.guard.text == "1 == 1" else f" {transition.guard.text}"
    effects = "; ".join(f"{name} = {expression.text}" for name, expression in transition.effects)
    return f"{transition.id}:{guard}" + (f" / {effects}" if effects else "")


def layout(chart: Chart) -> Layout:
    """Places every state, transition, initial dot and history."""
    return _Placer(chart).place()


class _Placer:
    def __init__(self, chart: Chart) -> None:
        self._chart = chart
        self._children = {
            state: [child.id for child in chart.states.values() if child.parent == state] for state in chart.states
        }
        self._incoming = {
            name: sum(1 for t in chart.transitions if t.target == name) for name in (*chart.states, *chart.histories)
        }
        self._lines = {t.id: wrapped(label(t)) for t in chart.transitions}
        self._result = Layout()
        self._headers: dict[str, float] = {}
        self._starts: list[tuple[Transition, tuple[Text, ...], float, float]] = []
        self._right = max(self._width(state) for state in chart.states)

    def _depth(self, state: str) -> int:
        return len(self._chart.ancestors(state)) - 1

    def _outputs(self, state: str) -> list[str]:
        found = [f"{name} = {expression.text}" for name, expression in self._chart.states[state].outputs.items()]
        decision = self._chart.states[state].decision
        return found + ([f"asks for {decision}"] if decision is not None else [])

    def _width(self, state: str) -> float:
        """x of the outermost right border that the texts of a state need."""
        own = [line for t in self._chart.transitions if t.source == state for line in self._lines[t.id]]
        longest = max(len(text) for text in (state + "    ", "; ".join(self._outputs(state)), *own))
        depth = self._depth(state)
        return _GUTTER * (depth + 1) + longest * CHARACTER + 3 * PAD + _INSET * depth

    def place(self) -> Layout:
        y = PAD
        for state in self._children_of_top():
            y = self._state(state, y) + _GAP
        self._initial(self._chart.initial, _GUTTER)
        lanes = self._route()
        self._result.width = self._right + _LANE * (lanes + 2) + PAD
        self._result.height = y
        self._result.boxes.sort(key=lambda box: self._depth(box.state))
        return self._result

    def _children_of_top(self) -> list[str]:
        return [state.id for state in self._chart.states.values() if state.parent is None]

    def _state(self, state: str, top: float) -> float:
        """Places a state at ``top``; returns its bottom."""
        chart, depth = self._chart, self._depth(state)
        x, right = _GUTTER * (depth + 1), self._right - _INSET * depth
        history = chart.states[state].history
        incoming = self._incoming[state] + (0 if history is None else self._incoming[history])
        header = max(HEADER, 10.0 + 7.0 * incoming)
        self._headers[state] = top
        texts = [Text(x + PAD, top + HEADER / 2, state, "name")]
        y = top + header
        if outputs := self._outputs(state):
            texts.append(Text(x + PAD, y + LINE / 2 - 2, "; ".join(outputs), "output"))
            y += LINE
        for transition in (t for t in chart.transitions if t.source == state):
            lines = self._lines[transition.id]
            row = tuple(
                Text(x + PAD + (2 * CHARACTER if k else 0), y + LINE * (k + 0.5), line, "row")
                for k, line in enumerate(lines)
            )
            self._starts.append((transition, row, right, y + LINE / 2))
            y += LINE * len(lines)
        for child in self._children[state]:
            y = self._state(child, y + _GAP)
        y += PAD
        found = chart.states[state]
        self._result.boxes.append(
            Box(
                state, x, top, right - x, y - top, not self._children[state], found.final, found.decision is not None,
                tuple(texts),
            )
        )  # fmt: skip
        if found.initial is not None:
            self._initial(found.initial, _GUTTER * (depth + 2))
        if history is not None:
            at = top + 8.0 + 7.0 * self._incoming[state] + 3.5 * max(self._incoming[history], 1)
            self._result.marks.append(Mark(right - 14.0, at, history, None))
        return y

    def _initial(self, state: str, x: float) -> None:
        y = self._headers[state] + HEADER / 2
        self._result.marks.append(Mark(x - 20.0, y, None, (x, y)))

    def _route(self) -> int:
        """Leads every arrow through the innermost free lane; returns the number of lanes."""
        used: dict[str, int] = {}
        spans: list[tuple[float, float, int]] = []
        colors = {state: k for k, state in enumerate(self._chart.states)}
        boxes = {box.state: box for box in self._result.boxes}
        ends: dict[int, tuple[float, float]] = {}
        # Arrows into one header, in the order of their rows, so that they do not cross there.
        for k, (transition, _, _, _) in enumerate(self._starts):
            target = transition.target
            if target is None:
                continue
            box = boxes[self._chart.histories.get(target, target)]
            nth = used.get(target, 0)
            used[target] = nth + 1
            offset = 7.0 * self._incoming[box.state] if target in self._chart.histories else 0.0
            ends[k] = (box.right - (7.0 if target in self._chart.histories else 0.0), box.y + 8.0 + offset + 7.0 * nth)
        order = sorted(ends, key=lambda k: abs(ends[k][1] - self._starts[k][3]))
        routed: dict[int, tuple[tuple[float, float], ...]] = {}
        for k in order:
            _, _, start_x, start_y = self._starts[k]
            end_x, end_y = ends[k]
            low, high = min(start_y, end_y) - 3.0, max(start_y, end_y) + 3.0
            taken = {lane for a, b, lane in spans if a < high and low < b}
            lane = next(lane for lane in range(len(spans) + 1) if lane not in taken)
            spans.append((low, high, lane))
            x = self._right + _LANE * (lane + 1.5)
            routed[k] = ((start_x, start_y), (x, start_y), (x, end_y), (end_x, end_y))
        for k, (transition, texts, _, _) in enumerate(self._starts):
            self._result.rows.append(Row(transition, texts, routed.get(k, ()), colors[transition.source]))
        return max((lane for _, _, lane in spans), default=-1) + 1

"""Pictures of charts: everything is there once, nothing overlaps, arrows go from source to target."""

import xml.etree.ElementTree as ET

import pytest

from pace_drake.statechart import compile_chart, load_chart
from pace_drake.statechart.draw import FIRED, Highlight, highlight_of, to_svg, write_png
from pace_drake.statechart.graphviz import has_dot, svg_by_dot, to_dot
from pace_drake.statechart.layout import CHARACTER, LINE, label, layout, wrapped
from pace_drake.statechart.mermaid import to_mermaid
from tests.statechart.test_lower import CORNERS
from tests.statechart.traces import shipped

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(params=["pace_task", "robot", "fig2_literal", "operator", "corners"])
def chart(request, tmp_path):
    if request.param != "corners":
        return shipped(request.param).chart
    path = tmp_path / "corners.scxml"
    path.write_text(CORNERS)
    return load_chart(path)


def test_everything_is_there_once_and_inside(chart):
    root = ET.fromstring(to_svg(chart))
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    expected = [f"state-{s}" for s in chart.states] + [f"transition-{t.id}" for t in chart.transitions]
    assert sorted(ids) == sorted([*expected, *(f"history-{h}" for h in chart.histories)])
    found = layout(chart)
    for row in found.rows:
        assert all(0 <= x <= found.width and 0 <= y <= found.height for x, y in row.points)


def test_texts_are_inside_their_state_and_do_not_overlap(chart):
    found = layout(chart)
    boxes = {box.state: box for box in found.boxes}
    extents = []
    owners = [(text, box.state) for box in found.boxes for text in box.texts]
    owners += [(text, row.transition.source) for row in found.rows for text in row.texts]
    for text, state in owners:
        left, right = text.x, text.x + len(text.text) * CHARACTER
        top, bottom = text.y - LINE / 2 + 1, text.y + LINE / 2 - 1
        box = boxes[state]
        assert box.x < left
        assert right < box.right, text
        assert box.y < top + 2
        assert bottom - 2 < box.y + box.height
        for child in found.boxes:
            if chart.states[child.state].parent == state:
                assert bottom <= child.y or top >= child.y + child.height
        extents.append((left, right, top, bottom))
    for k, (left, right, top, bottom) in enumerate(extents):
        for a, b, c, d in extents[:k]:
            assert right <= a or b <= left or bottom <= c or d <= top


def test_states_stand_inside_their_parents_and_beside_their_sisters(chart):
    boxes = {box.state: box for box in layout(chart).boxes}
    for state in chart.states.values():
        box = boxes[state.id]
        if state.parent is not None:
            around = boxes[state.parent]
            assert around.x < box.x
            assert box.right < around.right
            assert around.y < box.y
            assert box.y + box.height < around.y + around.height
        for other in chart.states.values():
            if other.parent == state.parent and other is not state:
                assert boxes[other.id].y >= box.y + box.height or box.y >= boxes[other.id].y + boxes[other.id].height


def test_arrows_lead_from_the_row_to_the_target_without_running_into_each_other(chart):
    found = layout(chart)
    boxes = {box.state: box for box in found.boxes}
    segments = []
    for row in found.rows:
        transition = row.transition
        if transition.target is None:
            assert row.points == ()
            continue
        source, target = boxes[transition.source], boxes[chart.histories.get(transition.target, transition.target)]
        (x1, y1), (lane, _), _, (x2, y2) = row.points
        assert x1 == source.right
        assert source.y < y1 < source.y + source.height
        assert abs(x2 - target.right) <= 7.0
        assert target.y < y2 < target.y + target.height
        assert lane > max(box.right for box in found.boxes)
        segments.append((lane, min(y1, y2), max(y1, y2)))
    for k, (lane, low, high) in enumerate(segments):
        assert not any(lane == other and a <= high and low <= b for other, a, b in segments[:k])
    ends = [row.points[-1] for row in found.rows if row.points]
    assert len(set(ends)) == len(ends)


def test_labels_are_guard_and_effect():
    chart = shipped("pace_task").chart
    labels = {t.id: label(t) for t in chart.transitions}
    assert labels["d_no"] == "d_no: a == 0 / i = i % M + 1; cmd = cmd + 1"
    assert labels["s_fault"] == "s_fault: fault == 1"
    assert label(shipped("policy").chart.transitions[0]) == "answers: / answer = choice"
    assert " ".join(wrapped(labels["s_reissue"], 20)) == labels["s_reissue"]


def test_what_is_active_and_what_fired_stands_out(tmp_path):
    compiled = shipped("pace_task")
    x, fired = compiled.react(compiled.initial_state(), compiled.inputs(), compiled.parameters(), 0.0)
    highlight = highlight_of(compiled, x, [compiled.chart.transitions[fired].id])
    assert highlight == Highlight(frozenset({"ROBOT_TASK", "RUN"}), frozenset({"t_start"}))
    classes = {e.get("id"): e.get("class") for e in ET.fromstring(to_svg(compiled.chart, highlight)).iter(f"{SVG}g")}
    assert {i for i, c in classes.items() if i and "active" in c.split()} == {"state-ROBOT_TASK", "state-RUN"}
    assert {i for i, c in classes.items() if i and "fired" in c.split()} == {"transition-t_start"}
    assert {i for i, c in classes.items() if i and "preemptive" in c.split()} == {
        "transition-t_stop",
        "transition-t_fault",
    }
    assert FIRED in to_dot(compiled.chart, highlight)


def test_png(tmp_path):
    from matplotlib.image import imread

    write_png(shipped("pace_task").chart, tmp_path / "a.png", dpi=50)
    write_png(shipped("pace_task").chart, tmp_path / "b.png", Highlight(frozenset({"WAIT"})), dpi=50)
    plain, active = imread(tmp_path / "a.png"), imread(tmp_path / "b.png")
    assert plain.shape == active.shape
    assert 0.005 < (abs(plain - active) > 0.01).any(axis=2).mean() < 0.2
    assert 0.02 < (plain[..., :3].mean(axis=2) < 0.6).mean() < 0.3  # there is ink


def test_mermaid_has_every_transition(chart):
    lines = to_mermaid(chart).splitlines()
    assert lines[0] == "stateDiagram-v2"
    arrows = [line.split(": ", 1) for line in lines if "-->" in line and "[*]" not in line]
    assert [head.strip() for head, _ in arrows] == [
        f"{t.source} --> {chart.histories.get(t.target or t.source, t.target or t.source)}" for t in chart.transitions
    ]
    assert all(not set(text) & set('<>&"') and ":" not in text for _, text in arrows)
    assert lines.count("    }") == sum(1 for s in chart.states.values() if s.initial and s.parent is None)


def test_graphviz(chart):
    text = to_dot(chart)
    assert all(f'id="transition-{t.id}"' in text and f"{t.id}:" in text for t in chart.transitions)
    if not has_dot():
        pytest.skip("Graphviz (dot) is not installed")
    root = ET.fromstring(svg_by_dot(chart).split("?>", 1)[1].split(">", 1)[1])
    ids = {element.get("id") for element in root.iter()}
    assert ids.issuperset({f"transition-{t.id}" for t in chart.transitions} | {f"state-{s}" for s in chart.states})


def test_guards_are_escaped(tmp_path):
    compiled = compile_chart(shipped("human").chart)
    assert "&amp;&amp; j &lt; L" in to_svg(compiled.chart)

"""pace_drake.statechart.check: verdicts, shortest counterexamples, and the design errors that exploration found."""

import itertools
import math
from collections import deque

import numpy as np
import pytest

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.statechart.check import check, check_chart, load_spec
from pace_drake.statechart.check.fairness import fair_components, find_lasso
from pace_drake.statechart.check.spec import ComponentSpec
from pace_drake.statechart.loader import load_chart
from tests.statechart.design_errors import DESIGN_ERRORS, check_mutated

PACE_TASK = "statecharts/pace_task.checks.yaml"


def verdicts(report):
    return {verdict.name: verdict for verdict in report.verdicts}


@pytest.mark.parametrize("name", ["pace_task", "query_latch"])
def test_what_comes_with_the_package_holds(name):
    report = check(load_spec(resource_path(f"statecharts/{name}.checks.yaml")))
    assert [v.name for v in report.verdicts if not v.holds] == []


@pytest.mark.parametrize("parameters", [{"M": 1, "L": 1}, {"D0": 0}, {"Tdec": 1, "Twait": 1}, {"M": 8, "L": 6}])
def test_it_holds_for_other_parameters(parameters):
    report = check(load_spec(resource_path(PACE_TASK), parameters=parameters))
    assert [v.name for v in report.verdicts if not v.holds] == []


def test_it_holds_when_the_task_reacts_to_rest_as_in_the_diagram(tmp_path):
    text = (
        resource_path(PACE_TASK)
        .read_text()
        .replace("{chart: pace_task.scxml,", "{chart: pace_task.scxml, to_rest: true,")
    )
    for path in resource_path("statecharts").glob("*.scxml"):
        (tmp_path / path.name).write_text(path.read_text())
    (tmp_path / "rest.checks.yaml").write_text(text)
    report = check(load_spec(tmp_path / "rest.checks.yaml"))
    assert [v.name for v in report.verdicts if not v.holds] == []
    assert report.states != check(load_spec(resource_path(PACE_TASK))).states


@pytest.mark.parametrize("name", DESIGN_ERRORS)
def test_design_errors_are_found(name, tmp_path):
    error = DESIGN_ERRORS[name]
    verdict = verdicts(check_mutated(tmp_path, error.changes))[error.broken]
    assert not verdict.holds
    assert len(verdict.rows) == error.depth
    assert (verdict.loop is not None) == (error.broken == "every episode ends")


def test_an_episode_need_not_end_if_the_policy_never_assists_or_the_person_never_comes(tmp_path):
    text = resource_path(PACE_TASK).read_text()
    for path in resource_path("statecharts").glob("*.scxml"):
        (tmp_path / path.name).write_text(path.read_text())
    for assumption in ("the policy assists now and then, ", "the person comes, "):
        assert assumption in text
        (tmp_path / "c.checks.yaml").write_text(text.replace(f"fair: [{assumption}", "fair: [").replace(assumption, ""))
        verdict = verdicts(check(load_spec(tmp_path / "c.checks.yaml")))["every episode ends"]
        assert not verdict.holds
        assert verdict.loop is not None


# ---- small charts, against a search written out plainly

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" xmlns:pace="urn:pace-drake:statechart" name="{name}">\n'
LEFT = (
    HEAD.format(name="left")
    + """<datamodel>
<data id="go" pace:role="input" pace:type="boolean"/><data id="other" pace:role="input" pace:type="integer"/>
<data id="n" pace:type="integer"/><data id="unused"/><data id="since" pace:type="time"/>
<data id="count" expr="n" pace:role="output" pace:type="integer"/></datamodel>
<state id="A"><transition pace:id="up" cond="go == 1 &amp;&amp; n &lt; 3" target="B">
 <assign location="n" expr="n + 1"/><assign location="since" expr="now"/><assign location="unused" expr="unused + 1"/>
</transition></state>
<state id="B"><transition pace:id="back" cond="other != 3 &amp;&amp; now &gt;= since + 2" target="A"/></state>
</scxml>"""
)
RIGHT = (
    HEAD.format(name="right")
    + """<datamodel>
<data id="count" pace:role="input" pace:type="integer"/><data id="m" pace:type="integer"/>
<data id="k" expr="m" pace:role="output" pace:type="integer"/></datamodel>
<state id="S"><transition pace:id="copy" cond="count != m"><assign location="m" expr="count"/></transition></state>
</scxml>"""
)
CHECKS = """
components: {left: {chart: left.scxml}, right: {chart: right.scxml}}
connections: {left.other: right.k, right.count: left.count}
free: {left.go: [0, 1]}
fairness: {it goes: {when: left.A, then: left.go == 1}}
properties:
"""


@pytest.fixture
def small(tmp_path):
    (tmp_path / "left.scxml").write_text(LEFT)
    (tmp_path / "right.scxml").write_text(RIGHT)

    def run(*properties: str):
        path = tmp_path / "small.checks.yaml"
        path.write_text(CHECKS + "".join(f"  - {p}\n" for p in properties))
        return load_spec(path)

    return run


def plain_distance(spec, holds) -> int | None:
    """Ticks until ``holds(leaves and variables before, after)`` first, by plain search with real times."""
    left, right = (part.compiled for part in spec.components)
    start = (tuple(left.initial_state().tolist()), tuple(right.initial_state().tolist()), 0)
    queue, seen = deque([(start, 0)]), {start}
    while queue:
        (x, y, time), depth = queue.popleft()
        for go in (0.0, 1.0):
            m = y[right.variable_index["m"]]
            n = x[left.variable_index["n"]]
            x2, _ = left.react(list(x), [go, m], [], float(time))
            y2, _ = right.react(list(y), [n], [], float(time))
            if holds(x, y, x2, y2):
                return depth + 1
            following = (tuple(x2), tuple(y2), time + 1)
            if depth < 14 and following not in seen:
                seen.add(following)
                queue.append((following, depth + 1))
    return None


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("left.n == 3", lambda x, y, x2, y2: x[1] == 3),
        ("left.B && right.m' == 2 && right.m == 1", lambda x, y, x2, y2: x[0] == 1 and y2[1] == 2 and y[1] == 1),
        ("left.back && left.n == 2", lambda x, y, x2, y2: x[0] == 1 and x2[0] == 0 and x[1] == 2),
        ("left.n == 1 && left.go == 1 && right.m == 1", lambda x, y, x2, y2: x[1] == 1 and y[1] == 1),
        ("left.count' == 2 && right.k == 1 && left.A", lambda x, y, x2, y2: x2[1] == 2 and y[1] == 1 and x[0] == 0),
        ("left.n == 4", lambda x, y, x2, y2: x[1] == 4),
    ],
)
def test_the_shortest_way_is_that_of_a_plain_search(small, text, holds):
    report = verdicts(check(small(f'{{name: p, reachable: "{text}"}}', f'{{name: q, never: "{text}"}}')))
    expected = plain_distance(small('{name: p, reachable: "left.A"}'), holds)
    assert report["p"].holds == (expected is not None)
    assert report["q"].holds == (expected is None)
    assert len(report["p"].rows) == len(report["q"].rows) == (expected or 0)


def test_what_cannot_matter_is_forgotten(small):
    """``unused`` runs on and times go by: 4 values of n, its copy, 2 leaves and 4 ages are what can matter."""
    report = check(small('{name: p, reachable: "left.A"}'))
    assert 8 < report.states < 4 * 2 * 2 * 4


KEEP = (
    HEAD.format(name="keep")
    + """<datamodel>
<data id="go" pace:role="input" pace:type="boolean"/><data id="value" pace:role="input" pace:type="integer"/>
<data id="v" pace:type="integer"/><data id="out" expr="v" pace:role="output" pace:type="integer"/></datamodel>
<state id="S"><transition pace:id="take" cond="go == 1"><assign location="v" expr="value"/></transition></state>
</scxml>"""
)


def test_what_is_read_at_once_is_remembered_while_nothing_fires(tmp_path):
    (tmp_path / "keep.scxml").write_text(KEEP)
    (tmp_path / "copy.scxml").write_text(RIGHT.replace('name="right"', 'name="copy"'))
    (tmp_path / "keep.checks.yaml").write_text("""
components: {keep: {chart: keep.scxml}, copy: {chart: copy.scxml}}
immediate: [keep]
connections: {copy.count: keep.out}
free: {keep.go: [0, 1], keep.value: [1, 2]}
properties:
  - {name: kept, always: "copy.m == 2 && keep.go == 0 => copy.m' == 2"}
  - {name: taken, reachable: "copy.m == 2"}
""")
    assert check(load_spec(tmp_path / "keep.checks.yaml")).holds


def test_liveness_needs_its_assumption(small):
    assert verdicts(check(small('{name: p, eventually: "right.m == 3", fair: [it goes]}')))["p"].holds
    # From n = 2 on, n = 1 is behind for ever.
    for text in (
        '{name: p, eventually: "right.m == 3"}',
        '{name: p, eventually: "left.n == 4", fair: [it goes]}',
        '{name: p, from: "left.n == 2", eventually: "left.n == 1", fair: [it goes]}',
    ):
        verdict = verdicts(check(small(text)))["p"]
        assert not verdict.holds
        assert verdict.loop is not None


# ---- fair loops, against plain enumeration


def plain_fair(num, edges, pairs) -> bool:
    """Whether some set of steps that is strongly connected satisfies all pairs: all subsets, for tiny graphs."""
    for size in range(1, len(edges) + 1):
        for subset in itertools.combinations(range(len(edges)), size):
            if not all(not any(w[k] for k in subset) or any(t[k] for k in subset) for w, t in pairs):
                continue
            nodes = {edges[k][0] for k in subset} | {edges[k][1] for k in subset}
            reach = {n: {n} for n in nodes}
            for _ in nodes:
                for k in subset:
                    for n in nodes:
                        if edges[k][0] in reach[n]:
                            reach[n].add(edges[k][1])
            if all(reach[n] == nodes for n in nodes):
                return True
    return False


@pytest.mark.parametrize("seed", range(40))
def test_fair_loops_are_those_of_plain_enumeration(seed):
    rng = np.random.default_rng(seed)
    num, count = int(rng.integers(2, 5)), int(rng.integers(1, 8))
    sources, targets = rng.integers(num, size=count), rng.integers(num, size=count)
    pairs = [(rng.random(count) < 0.4, rng.random(count) < 0.3) for _ in range(2)]
    expected = plain_fair(num, list(zip(sources.tolist(), targets.tolist(), strict=True)), pairs)
    assert (fair_components(num, sources, targets, pairs) >= 0).any() == expected
    lasso = find_lasso(num, (sources, targets), np.arange(num), (sources, targets), pairs)
    assert (lasso is not None) == expected
    if lasso is not None:
        steps = set(zip(sources.tolist(), targets.tolist(), strict=True))
        assert lasso.loop[0] == lasso.loop[-1] == lasso.stem[-1]
        assert set(itertools.pairwise(lasso.loop)) <= steps


# ---- what is wrong with a file


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("components:", "parts:", "unknown key 'parts'"),
        ("chart: left.scxml", "file: left.scxml", "unknown key 'file'"),
        ("left.other: right.k", "left.other: right.z", "unknown name 'right.z'"),
        ("left.other: right.k", "left.othr: right.k", "has no input 'othr'; it has go, other"),
        ("left.other: right.k", "left.other: up", "write component.name"),
        ("left.go: [0, 1]", "left.go: 1", "must be a list of values"),
        ("left.go: [0, 1]", "left.go: [0, yes]", "must be a number, not True"),
        ("when: left.A", "when: left.n", "'left.n' cannot stand here; write left.n != 0"),
        ("when: left.A", "when: left.A == 1", "'left.A' cannot stand here; it is a state"),
        ("then: left.go == 1", "when: left.B", "needs 'when' and 'then'"),
        ("when: left.A", "when: left.since == 1", "cannot be compared"),
        ("when: left.A", "when: left.go' == 1", "has no value after it"),
        ("never:", "newer:", "needs 'name' and one of always, eventually, never, reachable"),
        ("name: p,", "name: p, fair: [],", "unknown key 'fair'"),
        (
            "  - {name: p, never",
            "  - {name: p, never: left.n == 8}\n  - {name: p, never",
            "two properties are named 'p'",
        ),
        ("components:", "\tcomponents:", r":2: not readable as YAML"),
        ("components: {left", "immediate: [right]\ncomponents: {left", "which must stand before it"),
        ("components: {left", "sequences: [left.A]\ncomponents: {left", "must name variables"),
    ],
)
def test_mistakes_in_the_checks_give_one_line(small, tmp_path, old, new, message):
    spec = small("{name: p, never: left.n == 9}")
    path = tmp_path / "small.checks.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message) as error:
        load_spec(path)
    assert str(path) in str(error.value)
    assert spec.path == str(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"other" pace:role="input" pace:type="integer"',
            '"other" pace:role="input" pace:type="sequence"',
            "right.k is a plain",
        ),
        ('"go" pace:role="input" pace:type="boolean"', '"go" pace:role="input" pace:type="time"', "connect it"),
        (
            '<data id="unused"/>',
            '<data id="unused"/><data id="p" pace:role="parameter" pace:type="time"/>',
            "never moves",
        ),
    ],
)
def test_times_and_numbers_come_from_where_they_can_be_counted_anew(small, tmp_path, old, new, message):
    small("{name: p, never: left.n == 9}")
    assert old in LEFT
    text = LEFT.replace(old, new).replace("go == 1", "n &gt;= 0").replace("other != 3", "n &gt;= 0")
    (tmp_path / "left.scxml").write_text(text)
    with pytest.raises(InputError, match=message):
        load_spec(tmp_path / "small.checks.yaml")


def test_a_timer_that_runs_from_the_start_is_played_again_exactly(tmp_path):
    (tmp_path / "timer.scxml").write_text(
        HEAD.format(name="timer")
        + """<datamodel><data id="since" pace:type="time"/></datamodel>
<state id="A"><transition pace:id="rings" cond="now &gt;= since + 2" target="B"/></state><state id="B"/></scxml>"""
    )
    (tmp_path / "timer.checks.yaml").write_text(
        "components: {timer: {chart: timer.scxml}}\nproperties: [{name: p, reachable: timer.rings}]\n"
    )
    verdict = verdicts(check(load_spec(tmp_path / "timer.checks.yaml")))["p"]
    assert [row.fired for row in verdict.rows] == [{}, {}, {"timer": ["rings"]}]


@pytest.mark.parametrize("data", [b"[" * 100_000, b"\xff\xfe\x00", b"a: &a [*a]", b"x" * 300_000])
def test_what_is_no_check_at_all_gives_one_line(tmp_path, data):
    path = tmp_path / "wild.checks.yaml"
    path.write_bytes(data)
    with pytest.raises(InputError) as error:
        load_spec(path)
    assert "\n" not in " ".join(str(error.value).split())
    assert str(path) in str(error.value)


def test_a_counter_without_end_says_what_to_do(small):
    small("{name: p, never: left.n == 9}")
    spec = small("{name: p, never: left.unused == 9}")
    with pytest.raises(InputError, match="more than 50 states; give times and sequence numbers their pace:type"):
        check(_without_limit(spec), max_states=50)


def _without_limit(spec):
    from dataclasses import replace

    from pace_drake.statechart import compile_chart

    part: ComponentSpec = spec.components[0]
    chart = part.compiled.chart
    up = chart.transitions[0]
    loop = replace(up, target=None, guard=chart.transitions[0].guard.__class__("go == 1", _compare("go == 1")))
    changed = replace(part, compiled=compile_chart(replace(chart, transitions=(loop, *chart.transitions[1:]))))
    return replace(spec, components=(changed, *spec.components[1:]))


def _compare(text):
    from pace_drake.statechart.expressions import parse_expression

    return parse_expression(text).tree


def test_a_chart_that_fails_is_a_counterexample(small, tmp_path):
    small("{name: p, never: left.n == 9}")
    (tmp_path / "left.scxml").write_text(LEFT.replace('expr="n + 1"', 'expr="n + 1 + 1 % (n - 1)"'))
    report = check(load_spec(tmp_path / "small.checks.yaml"))
    verdict = verdicts(report)["no chart fails"]
    assert not verdict.holds
    assert "ZeroDivisionError" in verdict.text
    assert len(verdict.rows) == 3
    assert not math.isnan(verdict.seconds)


def test_guards_alone(tmp_path):
    path = tmp_path / "dead.scxml"
    path.write_text(LEFT.replace("go == 1 &amp;&amp; n &lt; 3", "go == 1 &amp;&amp; go == 0"))
    report = check_chart(load_chart(path))
    assert [v.holds for v in report.verdicts] == [True, False]
    assert "up can never be taken" in report.verdicts[1].text

"""pace_drake.statechart.loader: each kind of mistake gives one line with file, line and what to do."""

import re

import pytest

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.statechart import load_chart

HEAD = (
    '<scxml xmlns="http://www.w3.org/2005/07/scxml" xmlns:pace="urn:pace-drake:statechart" version="1.0" initial="A">\n'
    '<datamodel>\n<data id="u" expr="0" pace:role="input"/>\n<data id="n" expr="0"/>'
    '<data id="t" expr="0" pace:type="time"/><data id="out" pace:role="output"/>\n</datamodel>\n'
)
TWO = (
    '<state id="A"><transition cond="u == 1" target="B"/></state>\n'
    '<state id="B"><transition cond="u == 0" target="A"/></state>\n'
)


def write(tmp_path, body, head=HEAD):
    path = tmp_path / "chart.scxml"
    path.write_text(head + body + "</scxml>\n")
    return path


def test_the_chart_of_the_paper():
    chart = load_chart(resource_path("statecharts/pace_task.scxml"))
    assert chart.leaves == (
        "READY", "ROBOT_TASK", "DECIDE", "PREP", "WAIT", "JOINT", "HOMING", "STOPPED", "FAULT", "DONE",
    )  # fmt: skip
    assert len(chart.transitions) == 20
    assert chart.ancestors("PREP") == ["PREP", "ASSISTING", "RUN"]
    assert chart.initial_leaf("RUN") == "ROBOT_TASK"
    assert list(chart.parameters) == ["M", "L", "D0", "Tdec", "Twait"]


def test_a_small_chart_loads(tmp_path):
    assert load_chart(write(tmp_path, TWO)).leaves == ("A", "B")


@pytest.mark.parametrize(
    ("body", "line", "message"),
    [
        (TWO.replace("u == 1", "v == 1"), 6, "unknown name 'v'; declare it"),
        (TWO.replace("u == 1", "u = 1"), 6, "'=' is not part of the expression language"),
        (TWO.replace('target="B"', 'target="C"'), 6, "unknown target 'C'"),
        (TWO + '<state id="C"/>\n', 8, "'C' can never be reached"),
        (TWO + '<parallel id="C"/>\n', 8, "unknown element <parallel>"),
        (TWO.replace('id="B"', 'id="A"'), 7, "'A' is used twice"),
        (TWO.replace('<state id="B">', '<state id="B" colour="red">'), 7, "unknown attribute 'colour'"),
        (TWO + '<state id="C"><transition/></state>\n', 8, "neither target nor effect; remove it"),
        (TWO.replace("u == 1", "u"), 6, "a number where a condition is needed; write u != 0"),
        (TWO.replace("u == 1", "now - 2 == n"), 6, "is a time, 'n' is a plain number"),
        (TWO.replace("u == 1", "!(now &gt;= t)"), 6, "reads the time in '!\\(now >= t\\)'; write now >="),
        (TWO.replace("u == 1", "now &gt;= t + now - t"), 6, "reads the time in"),
        (
            TWO.replace('target="B"/>', 'target="B"><assign location="n" expr="now"/></transition>'),
            6,
            "assigns 'now', a time, to 'n', which is a plain number",
        ),
        (
            TWO.replace("</state>", '<transition cond="u &gt;= 1" target="A"/></state>', 1),
            6,
            "can both be enabled .u = 1",
        ),
        (TWO.replace('id="B"', 'id="B" pace:output="o = n"'), 7, "unknown output 'o'; declare it"),
        (TWO.replace('id="B"', 'id="B" pace:output="out = t"'), 7, "is a time, but its type says a plain number"),
        (TWO.replace('id="B"', 'id="B" pace:output="out = u"'), 7, "may not use the input 'u'"),
        (TWO.replace('id="B"', 'id="B" pace:output="n"'), 7, "write name = expression"),
        (TWO.replace('id="B"', 'id="B" pace:decision="n"'), 7, "unknown input 'n'"),
        (TWO.replace('id="B"', 'id="var"').replace('"B"', '"var"'), 7, "'var' cannot name a state"),
        (TWO.replace('id="B"', 'id="u"').replace('"B"', '"u"'), 7, "'u' is used twice, as input and as state"),
        (TWO.replace('id="B"', 'id="B" pace:final="yes"'), 7, "must be true or false"),
        (
            TWO.replace('target="B"/>', 'target="B"><assign location="u" expr="1"/></transition>'),
            6,
            "not a variable",
        ),
        (
            TWO.replace('target="B"/>', 'target="B"><assign location="n" expr="m"/></transition>'),
            6,
            "unknown name 'm'",
        ),
        ('<state id="B"><assign location="n" expr="1"/></state>', 6, "cannot stand inside <state>"),
        ("".join(f'<state id="s{k}">' for k in range(10_000)), 6, "nested deeper than 40"),
        (TWO + "text\n", 7, "unexpected text 'text'"),
        ("<state>", 6, "needs the attribute 'id'|not well-formed"),
        (TWO + "<state id='C' initial='A'><state id='D'/></state>\n", 8, "'A' is not directly inside 'C'"),
    ],
)
def test_mistakes_name_file_and_line(tmp_path, body, line, message):
    path = write(tmp_path, body)
    with pytest.raises(InputError, match=message) as error:
        load_chart(path)
    text = str(error.value)
    assert "\n" not in text
    found = re.match(rf"{re.escape(str(path))}:(\d+): ", text)
    assert found is not None, text
    assert int(found[1]) in (line, line + 1), text


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (HEAD.replace('id="n" expr="0"', 'id="n" expr="os.getcwd()"'), "must be a number"),
        (HEAD.replace('id="n" expr="0"', 'id="n" expr="nan"'), "must be finite"),
        (HEAD.replace('id="n"', 'id="u"'), "'u' is used twice, as input and as variable"),
        (HEAD.replace('role="input"', 'role="port"'), "unknown role 'port'"),
        (HEAD.replace('type="time"', 'type="date"'), "unknown type 'date'"),
        (HEAD.replace('initial="A"', 'initial="Z"'), "initial state 'Z' does not exist"),
        ('<!DOCTYPE scxml [<!ENTITY e "x">]>\n' + HEAD, "document type is not allowed"),
    ],
)
def test_mistakes_in_the_head(tmp_path, head, message):
    with pytest.raises(InputError, match=message):
        load_chart(write(tmp_path, TWO, head))


def test_unreadable_and_not_xml(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        load_chart(tmp_path / "absent.scxml")
    path = tmp_path / "chart.scxml"
    path.write_bytes(b"\x00\x01")
    with pytest.raises(InputError, match="not well-formed XML"):
        load_chart(path)


BOX = (
    '<state id="A"><transition cond="u == 1" target="{target}"/></state>\n'
    '<state id="R" initial="S"><history id="H" type="deep">{default}</history>\n'
    '<transition cond="u == 0" target="A"/><state id="S"><transition cond="n == 1" target="T"/></state>\n'
    '<state id="T">{inner}</state></state>\n'
)


@pytest.mark.parametrize(
    ("default", "inner", "message"),
    [
        ('<transition target="A"/>', "", "default target 'A', which is not inside it"),
        ('<transition target="T" cond="n == 1"/>', "", "nothing but a target"),
        ("", '<transition cond="n == 2" target="H"/>', "enters the history of 'R' from inside"),
    ],
)
def test_mistakes_with_histories(tmp_path, default, inner, message):
    with pytest.raises(InputError, match=message):
        load_chart(write(tmp_path, BOX.format(target="H", default=default, inner=inner)))


def test_a_history_has_a_default(tmp_path):
    inner = '<transition cond="n == 2" target="S"/>'
    chart = load_chart(write(tmp_path, BOX.format(target="H", default='<transition target="T"/>', inner=inner)))
    assert chart.history_default_leaf("H") == "T"


@pytest.mark.parametrize(
    ("first", "second", "exclude"),
    [
        ("u == 1", "u == 0", True),
        ("u == n", "n != u", True),
        ("u &lt; n", "n &lt;= u", True),
        ("u == 1 &amp;&amp; n &gt; 2", "n &lt; 1", True),  # not word by word: z3
        ("u % 2 == 1", "u % 2 == 0", True),
        ("u + n == 2", "u + n == 3", True),
        ("u % 2 == -1", "u == -1", False),  # the sign of the dividend
        ("u % 2 == -1", "u == 1", True),
        ("u == 1", "n == 0", False),
        ("u &gt;= n", "u &lt;= n", False),
        ("u == 1 || n == 1", "u == 0", False),
    ],
)
def test_two_transitions_of_one_state_must_exclude_each_other(tmp_path, first, second, exclude):
    head = HEAD.replace('pace:role="input"', 'pace:role="input" pace:type="integer"')
    head = head.replace('id="n" expr="0"', 'id="n" expr="0" pace:type="integer"')
    body = (
        f'<state id="A"><transition cond="{first}" target="B"/>\n<transition cond="{second}" target="B"/></state>\n'
        '<state id="B"/>\n'
    )
    path = write(tmp_path, body, head)
    if exclude:
        load_chart(path)
    else:
        with pytest.raises(InputError, match=r":7: transitions .* can both be enabled"):
            load_chart(path)

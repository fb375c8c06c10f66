"""pace_drake.statechart.loader: each kind of mistake gives one line with file, line and what to do."""

import re

import pytest

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.statechart import load_chart

HEAD = (
    '<scxml xmlns="http://www.w3.org/2005/07/scxml" xmlns:pace="urn:pace-drake:statechart" version="1.0" initial="A">\n'
    '<datamodel>\n<data id="u" expr="0" pace:role="input"/>\n<data id="n" expr="0"/>\n</datamodel>\n'
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
        (TWO + '<state id="C"><transition/></state>\n', 8, "neither target nor effect"),
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
        (HEAD.replace('id="n"', 'id="u"'), "declared twice"),
        (HEAD.replace('role="input"', 'role="output"'), "unknown role 'output'"),
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

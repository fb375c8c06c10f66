"""Pictures of Graphviz text: text that is none is refused with one line."""

import pytest

from pace_drake.errors import InputError
from pace_drake.graphviz import draw_dot, find_dot


@pytest.fixture
def program():
    try:
        return find_dot()
    except InputError as error:
        pytest.skip(str(error))


def test_both_kinds(program):
    assert b"<svg" in draw_dot("digraph { a -> b }", "svg")
    assert draw_dot("digraph { a -> b }", "png").startswith(b"\x89PNG")


def test_what_is_no_graph(program):
    with pytest.raises(InputError, match="syntax error"):
        draw_dot("digraph {", "svg")

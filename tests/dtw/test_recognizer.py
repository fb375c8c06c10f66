import math

import numpy as np
import pytest

from pace_drake.demos import synthetic_signals
from pace_drake.dtw.recognizer import ActionRecognizer
from pace_drake.errors import InputError

T = np.linspace(0, 1, 60)
CIRCLE = np.column_stack([np.cos(6 * T), np.sin(6 * T)])
LINE = np.column_stack([T, T**2])


@pytest.fixture(scope="module")
def people():
    return synthetic_signals().actions


@pytest.fixture(scope="module")
def fitted(people):
    return ActionRecognizer.fit(
        {one.action: [s.values for s in one.train] for one in people},
        {one.action: [s.subject for s in one.train] for one in people},
    )


def test_held_out_people_are_recognised(people, fitted):
    """SYNTHETIC people; the figures of docs/estimator.md. Probabilities must also mean what they say."""
    right, believed = [], []
    for k, one in enumerate(people):
        for signal in one.heldout_people[::2]:
            p = fitted.probabilities(signal.values[:51])[-1]
            right.append(p.argmax() == k)
            believed.append(p[k])
    assert np.mean(right) >= 0.9
    assert np.mean(believed) >= 0.8


def test_one_reference_for_each_person_and_action(people, fitted):
    assert fitted.actions == tuple(one.action for one in people)
    assert len(fitted._alignments) == 3 * 5


def test_streaming_equals_batch():
    dut = ActionRecognizer({"circle": [CIRCLE], "line": [LINE, LINE[::2]]})
    batch = dut.probabilities(CIRCLE)
    state = dut.initial_state()
    assert (dut.probabilities_at(state) == 0.5).all()
    for sample, p in zip(CIRCLE, batch, strict=True):
        dut.step(state, sample)
        assert (dut.probabilities_at(state) == p).all()
    np.testing.assert_allclose(batch.sum(axis=1), 1.0)
    assert batch[-1, 0] > 0.99


def test_the_lowest_of_an_actions_references_counts():
    alone = ActionRecognizer({"circle": [CIRCLE], "line": [LINE]}).probabilities(LINE)
    both = ActionRecognizer({"circle": [CIRCLE], "line": [CIRCLE[::-1], LINE]}).probabilities(LINE)
    assert both[-1, 1] == alone[-1, 1]


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: ActionRecognizer({}), "references"),
        (lambda: ActionRecognizer({"a": []}), "references"),
        (lambda: ActionRecognizer({"a": [CIRCLE], "b": [T[:, np.newaxis]]}), "references"),
        (lambda: ActionRecognizer({"a": [CIRCLE]}, temperature=0.0), "temperature"),
        (lambda: ActionRecognizer({"a": [CIRCLE]}).probabilities(np.zeros((0, 2))), "query"),
        (lambda: ActionRecognizer({"a": [CIRCLE]}).probabilities([[math.nan, 0.0]]), "query"),
        (lambda: ActionRecognizer.fit({"a": [CIRCLE]}, {"a": ["S1"]}), "people"),
        (lambda: ActionRecognizer.fit({"a": [CIRCLE], "b": [LINE]}, {"a": ["S1"], "b": ["S2"]}), "people"),
    ],
)
def test_bad_input_is_named(make, name):
    with pytest.raises(InputError, match=name):
        make()

"""Studies with participants: the tests, and their power."""

import numpy as np
import pytest
from scipy import stats

from pace_drake.evaluate.participants import Participants, holm, rank_biserial, study_of


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.9]) == [1.0, 1.0]


def test_effect():
    assert rank_biserial(np.array([1.0, 2.0, 3.0])) == 1.0
    assert rank_biserial(np.array([-1.0, 2.0, -3.0])) == pytest.approx((2 - 4) / 6)
    assert rank_biserial(np.zeros(3)) == 0.0


def test_the_paper_s_own_test():
    """12 people, W = 6: p = 0.007 two-sided, as the paper prints."""
    difference = np.array([1.0, 2, 3, 4, 5, -6, 7, 8, 9, 10, 11, 12])
    study = study_of({"a": difference + 20, "b": np.full(12, 20.0)}, 2)
    assert study.pairs[0].p == pytest.approx(0.0068359375)
    assert study.pairs[0].effect == pytest.approx((72 - 6) / 78)
    assert np.isnan(study.friedman_p)
    assert study.means == {"a": pytest.approx(20 + difference.mean()), "b": 20.0}


def test_three_methods():
    rng = np.random.default_rng(0)
    costs = {name: rng.normal(mean, 1, 12) for name, mean in (("x", 3), ("y", 2), ("z", 0))}
    study = study_of(costs, 2)
    assert study.friedman_p == stats.friedmanchisquare(*costs.values()).pvalue < 0.01
    assert [(p.first, p.second) for p in study.pairs] == [("x", "y"), ("x", "z"), ("y", "z")]
    assert all(p.p_holm >= p.p for p in study.pairs)


def people(effect, num=60, episodes=40):
    rng = np.random.default_rng(1)
    person = np.repeat(np.arange(num), episodes)
    own = rng.normal(0, 3, num)[person]
    return Participants(
        {"a": 20 + own + rng.normal(0, 8, len(person)), "b": 20 - effect + own + rng.normal(0, 8, len(person))}, person
    )


def test_power_grows_with_effect_and_people_and_is_the_level_without_any():
    rng = np.random.default_rng(2)
    assert people(0.0).power("a", "b", 12, 2, 400, rng) < 0.06
    few, many = (people(5.0).power("a", "b", n, 2, 200, rng) for n in (12, 36))
    assert 0.2 < few < many
    assert people(30.0).power("a", "b", 12, 2, 50, rng) == 1.0


def test_a_draw_keeps_people_together():
    """Every figure of a participant is of their own episodes."""
    person = np.repeat(np.arange(5), 10)
    one = Participants({"a": person * 1.0, "b": person * 10.0}, person)
    assert one.number == 5
    drawn = one.draw(5, 3, np.random.default_rng(0))
    assert sorted(drawn["a"]) == [0, 1, 2, 3, 4]
    assert (drawn["b"] == 10 * drawn["a"]).all()

"""pace operator: one press of a button."""

import pytest
from pydrake.lcm import DrakeLcm

from pace_drake.lcm.types import lcmt_pace_operator
from tests.cli.test_run import pace, refused
from tests.network import own_url

#: Nothing goes there: the tests take the LCM's place.
URL = own_url()


@pytest.mark.parametrize(
    ("word", "event"),
    [
        ("request", lcmt_pace_operator.REQUEST),
        ("stop", lcmt_pace_operator.STOP),
        ("ack", lcmt_pace_operator.ACKNOWLEDGE),
    ],
)
def test_one_press_is_published(monkeypatch, capsys, word, event):
    lcm, heard = DrakeLcm("memq://"), []
    lcm.Subscribe("B", lambda data: heard.append(lcmt_pace_operator.decode(data)))
    monkeypatch.setattr("pace_drake.lcm.url.open_lcm", lambda config: lcm)
    for _ in range(2):
        assert pace("operator", word, "--lcm-url", URL, "--channel", "B", "--sender", "me") == 0
    lcm.HandleSubscriptions(0)
    assert [(press.event, press.sender) for press in heard] == [(event, "me")] * 2
    assert heard[0].utime < heard[1].utime
    assert f"{word} sent on B" in capsys.readouterr().out


def test_bad_input(capsys):
    assert "--lcm-url" in refused(capsys, "operator", "stop")
    assert "request" in refused(capsys, "operator", "halt", "--lcm-url", URL)
    assert "must begin with memq://" in refused(capsys, "operator", "stop", "--lcm-url", "PANDA")
    assert "memq:// reaches nobody outside this process" in refused(capsys, "operator", "stop", "--lcm-url", "memq://")

"""pace record: a tracked hand, live or in a log, is added to a file of demonstrations; bad input loses nothing."""

import io

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm

from pace_drake.bridge.lcm_log import LcmLog
from pace_drake.demos import read_demonstrations
from pace_drake.demos.signals import folder_signals
from pace_drake.lcm.types import lcmt_pace_operator
from pace_drake.people import load_people
from pace_drake.scenario import load_scenario
from tests.cli.test_run import pace, refused
from tests.lcm.senders import hand, press
from tests.network import own_url

URL = own_url()
SHOWN = ("--action", "place_rails", "--subject", "P1")


def write_log(path, seconds=10.0, channel="PACE_HAND"):
    times = iter(np.arange(0, seconds, 1 / 60).tolist() * 2)
    with LcmLog(path, clock=lambda: 1e9 + next(times)) as log:
        for k in range(round(60 * seconds)):
            log.write(channel, hand(k, (0.5 + 0.1 * np.sin(k / 60), 0.1, 0.2), round(k * 1e6 / 60)))
    return path


def test_trials_cut_out_of_a_log_are_what_run_and_tune_read(tmp_path, capsys):
    log, folder = write_log(tmp_path / "lcm.log"), tmp_path / "people"
    folder.mkdir()
    for subject in ("P1", "P2"):
        for start in (0, 3, 6):
            options = ("--action", "place_rails", "--subject", subject, "--from", start, "--to", start + 3)
            assert pace("record", folder / "all.npz", "--log", log, *options) == 0
    assert "place_rails/P2/3, 3.0 s of 181 samples; 6 demonstrations in it" in " ".join(capsys.readouterr().out.split())
    recorded = read_demonstrations(folder / "all.npz")
    assert [one.name for one in recorded] == [f"place_rails/P{p}/{k}" for p in (1, 2) for k in (1, 2, 3)]
    assert not any(one.synthetic for one in recorded)
    np.testing.assert_allclose(recorded[1].p_WH[0], [0.5 + 0.1 * np.sin(3.0), 0.1, 0.2], atol=1e-6)
    assert len(folder_signals(folder).actions[0].signals) == 6
    people = load_people(load_scenario("ikea_chair", (f"human.demonstrations={folder / 'all.npz'}",)))
    assert people.description.startswith("recorded hands")
    # A run folder is a log, too.
    assert pace("record", folder / "all.npz", "--log", tmp_path, *SHOWN) == 0


def test_bad_input_leaves_the_file_as_it_is(tmp_path, capsys):
    log, file = write_log(tmp_path / "lcm.log"), tmp_path / "people.csv"
    assert pace("record", file, "--log", log, *SHOWN, "--trial", "a") == 0
    capsys.readouterr()
    before = file.read_bytes()
    with_log = ("record", file, "--log", log, *SHOWN)
    for arguments, line in (
        ((*with_log, "--trial", "a"), "already holds place_rails/P1/a; choose another --trial"),
        ((*with_log, "--period", 0.05), "holds samples every 0.1 s, not 0.05 s"),
        ((*with_log, "--period", "nan"), "--period: must be > 0 [s]"),
        ((*with_log, "--from", 5, "--to", 4), "0 <= from < to must hold, are 5 and 4 [s]"),
        ((*with_log, "--from", 50, "--to", 60), "no PACE_HAND from 50 to 60 s; its messages lie from 0.00 to 9.98 s"),
        ((*with_log, "--channel", "HAND"), "no HAND in it, but PACE_HAND; name the tracker's with --channel"),
        ((*with_log, "--lcm-url", URL), "give either --lcm-url"),
        (("record", file, *SHOWN), "give either --lcm-url"),
        (("record", file, "--log", tmp_path / "none", *SHOWN), "none: cannot read the log: No such file"),
        (("record", file, "--log", file, *SHOWN), "is no LCM log"),
        (("record", tmp_path / "people.txt", "--log", log, *SHOWN), "is neither .npz nor .csv"),
        (("record", tmp_path / "no" / "people.csv", "--log", log, *SHOWN), "no such folder"),
        (("record", log.with_suffix(".csv"), "--lcm-url", "http://x", *SHOWN), "must begin with memq://"),
    ):
        assert line in refused(capsys, *arguments)
    assert file.read_bytes() == before


class Tracked:
    """The LCM of a process whose tracker sends 60 samples a second, one at each look; presses at some of them."""

    def __init__(self, presses=(), synthetic=False, lost=()):
        self.lcm, self.number, self.presses = DrakeLcm("memq://"), 0, presses
        self.synthetic, self.lost = synthetic, lost
        self.Publish, self.Subscribe = self.lcm.Publish, self.lcm.Subscribe

    def HandleSubscriptions(self, timeout):
        k = self.number = self.number + 1
        if k == 2000:
            raise KeyboardInterrupt
        if k not in self.lost:
            self.lcm.Publish("PACE_HAND", hand(k, (0.5, k / 1000, 0.2), round(k * 1e6 / 60)))
        if self.synthetic:
            self.lcm.Publish("PACE_HAND_SYNTHETIC", b"SYNTHETIC people")
        if k in self.presses:
            self.lcm.Publish("PACE_OPERATOR", press(lcmt_pace_operator.REQUEST, 2_000_000 * k))
        return self.lcm.HandleSubscriptions(0)


def record(monkeypatch, file, tracked, typed="", url=URL):
    monkeypatch.setattr("pace_drake.lcm.url.open_lcm", lambda config: tracked)
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    return pace("record", file, "--lcm-url", url, *SHOWN)


def test_a_url_that_no_tracker_reaches(tmp_path, monkeypatch, capsys):
    assert record(monkeypatch, tmp_path / "people.csv", Tracked(), url="memq://") == 2
    assert "memq:// reaches nobody outside this process" in capsys.readouterr().err


def test_the_button_begins_and_ends_trials(tmp_path, monkeypatch, capsys):
    file = tmp_path / "people.csv"
    # The second one has a gap, and is shown again; the fourth is under way when Ctrl-C ends it all.
    tracked = Tracked((100, 400, 500, 800, 900, 1200, 1900), lost=range(600, 630))
    assert record(monkeypatch, file, tracked) == 130
    shown = capsys.readouterr()
    assert "not kept: place_rails/P1/2: no usable sample for 0.52 s, from 1.63 s on" in shown.out
    assert "2 trials were added to" in shown.err
    assert "not the one that was under way" in shown.err
    recorded = read_demonstrations(file)
    assert [(one.name, one.duration, one.synthetic) for one in recorded] == [
        ("place_rails/P1/1", pytest.approx(4.9, abs=0.11), False),
        ("place_rails/P1/2", pytest.approx(4.9, abs=0.11), False),
    ]
    np.testing.assert_allclose(recorded[1].p_WH[0], [0.5, 0.901, 0.2], atol=2e-3)


def test_the_keyboard_ends_it(tmp_path, monkeypatch, capsys):
    assert record(monkeypatch, tmp_path / "people.csv", Tracked(), "q\n") == 0
    assert "0 trials added" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_a_synthetic_hand_stays_synthetic(tmp_path, monkeypatch, capsys):
    record(monkeypatch, tmp_path / "people.csv", Tracked((100, 400), synthetic=True))
    assert "SYNTHETIC place_rails/P1/1" in capsys.readouterr().out
    assert all(one.synthetic for one in read_demonstrations(tmp_path / "people.csv"))

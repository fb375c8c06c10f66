"""pace demos: what it writes can be read, says that it is synthetic, and is never overwritten."""

from pace_drake.demos import read_demonstrations
from pace_drake.people import load_people
from pace_drake.scenario import load_scenario
from tests.cli.test_run import pace, refused


def test_written_demonstrations_are_read_back_and_labelled(tmp_path, capsys):
    path = tmp_path / "people.npz"
    assert pace("demos", path, "--subjects", 2, "--trials", 3, "--seed", 7) == 0
    assert "21 SYNTHETIC demonstrations" in capsys.readouterr().out
    recordings = read_demonstrations(path)
    assert len(recordings) == 3 * (1 + 2 * 3)
    assert all(d.synthetic for d in recordings)
    people = load_people(load_scenario("ikea_chair", (f"human.demonstrations={path}",)))
    assert people.description.startswith("SYNTHETIC hands from")  # through a file they are no recordings either
    before = path.read_bytes()
    assert "exists" in refused(capsys, "demos", path)
    assert path.read_bytes() == before


def test_bad_files(tmp_path, capsys):
    assert "no such folder" in refused(capsys, "demos", tmp_path / "no" / "people.npz")
    assert "people.txt" in refused(capsys, "demos", tmp_path / "people.txt")
    assert not list(tmp_path.iterdir())

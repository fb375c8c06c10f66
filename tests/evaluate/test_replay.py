"""The replay: what it says agrees with the log, and what it shows, in a real browser, with the 3D picture."""

import json
import re
from itertools import pairwise

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv
from scipy import ndimage

from pace_drake.cli.main import main
from pace_drake.errors import InputError
from pace_drake.evaluate.event_log import COLUMNS, event_row
from pace_drake.evaluate.replay import About, replay_page, story
from pace_drake.evaluate.screenshot import find_chromium, open_headless, screenshot
from pace_drake.evaluate.timeline import read_events
from pace_drake.scenario import load_scenario

ABOUT = About("ikea_chair", "policy learned, plant level, seed 1", "SYNTHETIC people, not recordings")
EMPTY = "<html><body><p>Meshcat</p></body></html>"


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("ikea_chair")


def run(out, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in ("run", "--policy", "phase_threshold", "--seed", 1, "--out", out, *arguments)])
    assert stop.value.code == 0
    return out


@pytest.fixture(scope="module")
def task_run(tmp_path_factory):
    """A whole episode, without the plant."""
    return run(tmp_path_factory.mktemp("runs") / "task", "--level", "task")


@pytest.fixture(scope="module")
def plant_run(tmp_path_factory):
    """The beginning of an episode: truncated after the second decision, in the middle of everything."""
    return run(tmp_path_factory.mktemp("runs") / "plant", "--level", "plant", "--set", "max_decisions=2")


def rows(*events):
    """Rows as ``read_events`` gives them, of (time, kind, values)."""
    made = [event_row(time, kind, **values) for time, kind, values in events]
    return [{name: str(row.get(name, "")) for name in COLUMNS} for row in made]


# ---- what it says


def test_the_story_agrees_with_the_summary(task_run, scenario):
    found = story(read_events(task_run / "events.csv"), scenario.task)
    episode = json.loads((task_run / "summary.json").read_text())["episodes"][0]
    assert found["end"] == episode["duration"]
    assert found["outcome"] == "finished"
    assert len(found["decisions"]) == episode["decisions"]
    for kind in ("robot_idle", "human_idle"):
        for joint in (1, 2, 3):
            total = sum(duration for _, duration, of in found[kind] if of == joint)
            assert total == pytest.approx(episode[kind][str(joint)], abs=1e-9)
    assert found["joints"] == ["carry_side", "hand_key", "hand_second_key"]


def test_the_story_has_no_gaps_and_names_everything(task_run, scenario):
    found = story(read_events(task_run / "events.csv"), scenario.task)
    for lane in ("robot", "human"):
        assert found[lane][0]["start"] == 0
        assert all(a["stop"] == b["start"] for a, b in pairwise(found[lane]))
        assert found[lane][-1]["stop"] == found["end"]
    labels = [one["label"] for one in found["robot"]]
    assert labels[0] == "ROBOT_TASK 1"
    assert labels[-1] == "DONE"
    assert [label for label in labels if label.startswith("JOINT")] == ["JOINT 1", "JOINT 2", "JOINT 3"]
    # Robot tasks go on where they were left, and homing is that of the joint action before it.
    numbers = [int(label.split()[1]) for label in labels if label.startswith("ROBOT_TASK")]
    assert numbers == [k % 4 + 1 for k in range(len(numbers))]
    for before, after in pairwise(labels):
        if before.startswith("JOINT"):
            assert after == before.replace("JOINT", "HOMING")
    names = {one["label"]: one["what"] for one in found["robot"]}
    assert names["ROBOT_TASK 2"] == "sort_yellow"
    assert names["PREPARE 2"] == names["HOMING 2"] == "hand_key"
    done = [one["what"] for one in found["human"]]
    assert [what for k, what in enumerate(done) if k == 0 or what != done[k - 1]] == [
        *(action.name for action in scenario.task.human_actions),
        "done",
    ]
    waiting = [(one["start"], one["stop"]) for one in found["human"] if one["waits"]]
    assert waiting == [(start, pytest.approx(start + length)) for start, length, _ in found["human_idle"]]
    assert {sample[1] for sample in found["phase"]} == {1, 3, 5}  # joint actions have no phase


def test_a_stop_and_a_decision_without_an_answer(scenario):
    events = rows(
        (0.0, "human", {"name": "place_rails", "human_action": 1}),
        (2.0, "reaction", {"name": "d_timeout", "source": "DECIDE", "target": "ROBOT_TASK"}),
        (2.0, "decision", {"human_action": 1, "phase": np.nan, "progress": 0.1, "assist": -1}),
        (2.0, "command", {"name": "ROBOT_TASK", "robot_task": 3, "duration": 8.0}),
        (4.0, "reaction", {"name": "t_stop", "source": "ROBOT_TASK", "target": "STOPPED"}),
        (4.0, "command", {"name": "HOLD", "joint_action": 0}),
        (5.0, "reaction", {"name": "s_resume", "source": "STOPPED", "target": "ROBOT_TASK"}),
        (6.0, "phase", {"human_action": 1, "phase": np.nan, "progress": 0.3}),
    )
    found = story(events, scenario.task)
    assert [(one["label"], one["start"], one["stop"]) for one in found["robot"]] == [
        ("ROBOT_TASK 3", 2.0, 4.0),
        ("STOPPED", 4.0, 5.0),
        ("ROBOT_TASK 3", 5.0, 6.0),
    ]
    assert found["decisions"][0]["phase"] is None
    assert found["phase"] == [[6.0, 1, None, 0.3]]
    assert found["outcome"] == ""
    page = replay_page(EMPTY, events, scenario.task, ABOUT)
    assert "NaN" not in page.split('id="pace-story">')[1].split("</script>")[0]


def test_nothing_has_happened_yet(scenario):
    for events in ([], rows((0.0, "episode", {"name": "start"}))):
        found = story(events, scenario.task)
        assert found["end"] == 0.0
        assert found["robot"] == found["human"] == found["decisions"] == []
        replay_page(EMPTY, events, scenario.task, ABOUT)


def test_the_page_carries_the_story_and_escapes_what_it_says(task_run, scenario):
    events = read_events(task_run / "events.csv")
    nasty = "</script><script>alert(1)</script><img src=x onerror=alert(2)> & \"'"
    page = replay_page(EMPTY, events, scenario.task, About(nasty, nasty, nasty))
    (text,) = re.findall(r'id="pace-story">(.*?)</script>', page)
    assert json.loads(text) == story(events, scenario.task)
    assert "alert(1)</script>" not in page
    assert "<img src=x" not in page
    assert page.startswith("<html><body><p>Meshcat</p>")
    assert page.endswith("</body></html>")
    assert "pace-synthetic" not in page.split("pace-people")[2].split(">")[0]
    assert "pace-synthetic" in replay_page(EMPTY, events, scenario.task, ABOUT).split("pace-people")[2].split(">")[0]


def test_the_page_asks_no_network(task_run, scenario):
    page = replay_page(EMPTY, read_events(task_run / "events.csv"), scenario.task, ABOUT)
    addresses = set(re.findall(r"https?://[^\"'\s)]+", page))
    assert addresses <= {"http://www.w3.org/2000/svg"}  # the name of SVG, no address


def test_only_a_page_is_taken(scenario):
    with pytest.raises(ValueError, match="no </body>"):
        replay_page("not a page", [], scenario.task, ABOUT)


# ---- what it shows

in_chromium = pytest.mark.skipif(find_chromium() is None, reason="Chromium is not installed (apt-get install chromium)")


@in_chromium
@pytest.mark.slow
def test_the_panel_follows_the_time(plant_run, scenario):
    found = story(read_events(plant_run / "events.csv"), scenario.task)
    assert found["outcome"] == "truncated"
    wait = next(one for one in found["robot"] if one["waits"])
    with open_headless(plant_run / "replay.html") as replay:

        def text(name):
            return replay.evaluate(f"document.getElementById('{name}').innerText")

        for time in (0.5, (wait["start"] + wait["stop"]) / 2, found["end"]):
            replay.go_to(time)
            robot = [one for one in found["robot"] if one["start"] <= time][-1]
            human = [one for one in found["human"] if one["start"] <= time][-1]
            assert text("pace-robot") == robot["label"]
            assert human["what"] in text("pace-human")
            idle = sum(min(max(time - start, 0.0), length) for start, length, _ in found["robot_idle"])
            waited = sum(min(max(time - start, 0.0), length) for start, length, _ in found["human_idle"])
            assert float(text("pace-cost").split()[-1]) == pytest.approx(idle + 3 * waited, abs=0.051)
            assert text("pace-decisions").count("\n") + 1 == sum(one["time"] <= time for one in found["decisions"])
            assert "SYNTHETIC people" in text("pace-panel")
            assert text("pace-time").endswith("truncated") == (time == found["end"])
            cursor = float(replay.evaluate("document.getElementById('pace-strip').lastChild.getAttribute('x1')"))
            assert cursor == pytest.approx(62 + (1280 - 62 - 14) * time / found["end"], abs=1.0)
        assert idle > 0


@in_chromium
@pytest.mark.slow
def test_the_panel_follows_the_animation(plant_run):
    with open_headless(plant_run / "replay.html") as replay:
        replay.go_to(1.0)
        replay.evaluate("document.getElementById('pace-play').click()")
        wait = "new Promise(done => { const w = () => viewer.animator.time > 1.5 ? done(1) : setTimeout(w, 20); w(); })"
        replay.evaluate(wait)
        replay.evaluate("document.getElementById('pace-play').click()")
        replay.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
        time = replay.evaluate("viewer.animator.time")
        assert time > 1.5
        assert replay.evaluate("document.getElementById('pace-time').innerText").startswith(f"{time:.1f} of")


@in_chromium
@pytest.mark.slow
def test_the_picture_shows_robot_tables_cubes_and_hand(plant_run, scenario, tmp_path):
    pictures = []
    for time in (2.0, 12.0):
        path = tmp_path / f"{time}.png"
        screenshot(plant_run / "replay.html", path, time)
        pictures.append(matplotlib.image.imread(path)[:, :, :3])
    picture = pictures[0]
    assert picture.shape == (720, 1280, 3)
    view = picture[:540, :940]  # beside the panel and above the strip
    hue, saturation, value = np.moveaxis(rgb_to_hsv(view), -1, 0)

    def spots(mask, size):
        labels, number = ndimage.label(ndimage.binary_opening(mask))
        sizes = ndimage.sum_labels(mask, labels, np.arange(1, number + 1))
        return int(np.sum(sizes >= size))

    def like(low, high, least):
        return (hue >= low) & (hue <= high) & (saturation >= least) & (saturation <= 0.6) & (value > 0.45)

    for color in scenario.workcell.colors:  # a cube and a tray of each
        off = np.abs(hue - rgb_to_hsv(color[:3])[0])
        assert spots((np.minimum(off, 1 - off) < 0.04) & (saturation > 0.5) & (value > 0.4), 25) >= 2, color
    assert like(0.09, 0.13, 0.2).sum() > 2500, "the wooden top of the assembly table"
    assert spots(like(0.03, 0.085, 0.3), 250) >= 3, "head and two arms with hands"
    assert (view.min(axis=-1) > 0.87).sum() > 3000, "white robot and tables"
    assert np.ptp(view, axis=(0, 1)).min() > 0.5, "anything at all"
    moved = np.abs(pictures[1][:540, :940] - view).max(axis=-1) > 0.15
    assert moved[:, :480].sum() > 1000, "the robot, left of the person, has moved"


@in_chromium
def test_a_page_that_is_no_replay_is_refused(tmp_path):
    page = tmp_path / "page.html"
    page.write_text(EMPTY)
    with pytest.raises(InputError, match="is not a replay that pace run wrote"):
        screenshot(page, tmp_path / "picture.png", 0.0)
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]

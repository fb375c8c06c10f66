"""The pool on disk: the same arrays, found by all that determines it, made again where it is damaged."""

import os
from copy import deepcopy
from dataclasses import fields, replace

import numpy as np
import pytest

from pace_drake.envs import pool as module
from pace_drake.envs.pool import MAX_CACHED, Phases, cached_pool, make_pool


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "cache_folder", lambda name: tmp_path)
    return tmp_path


def never(*_):
    raise AssertionError("phases were computed")


def arrays(pool):
    for field in fields(pool):
        value = getattr(pool, field.name)
        yield from arrays(value) if isinstance(value, Phases) else [(field.name, np.asarray(value))]


def assert_equal(one, other):
    for (name, a), (_, b) in zip(arrays(one), arrays(other), strict=True):
        assert a.dtype == b.dtype, name
        assert np.array_equal(a, b, equal_nan=True), name


def test_the_second_call_reads_what_the_first_made(chair, chair_people, folder, monkeypatch):
    drawn = make_pool(chair, chair_people, 6, np.random.default_rng([4, 1]))
    first = cached_pool(chair, chair_people, 6, [4, 1])
    monkeypatch.setattr(module, "exact_phases", never)
    again = cached_pool(chair, chair_people, 6, [4, 1])
    assert_equal(drawn, first)
    assert_equal(drawn, again)
    assert len(list(arrays(again))) == 10


def test_what_determines_a_pool_gives_another_file(chair, chair_people, folder, tmp_path_factory, monkeypatch):
    file = tmp_path_factory.mktemp("tuned") / "estimators.yaml"
    keys = {"": module.pool_key(chair, chair_people, 6, 0)}
    keys["seed"] = module.pool_key(chair, chair_people, 6, 1)
    keys["size"] = module.pool_key(chair, chair_people, 7, 0)
    for name, value in {
        "estimator_file": str(file),
        "estimator_file again": str(file),
        "observation": "fused",
        "human.sample_period": 0.2,
        "human.pace_correlation": 0.5,
    }.items():
        changed = deepcopy(chair)
        path = name.split(" ")[0].split(".")
        setattr(changed.human if len(path) == 2 else changed, path[-1], value)
        file.write_text(name)  # the same name, other content
        keys[name] = module.pool_key(changed, chair_people, 6, 0)
    changed = deepcopy(chair)
    changed.estimator["place_rails"].gamma += 0.1
    keys["estimator"] = module.pool_key(changed, chair_people, 6, 0)
    changed = deepcopy(chair)
    changed.task.human_actions[0].duration.mean += 1
    keys["task"] = module.pool_key(changed, chair_people, 6, 0)
    changed = deepcopy(chair_people)
    first = changed.demonstrations[0][0]
    changed.demonstrations[0][0] = replace(first, p_WH=first.p_WH + 1e-9)
    keys["people"] = module.pool_key(chair, changed, 6, 0)
    monkeypatch.setattr(module, "_MODULES", ("people", "task"))
    keys["program"] = module.pool_key(chair, chair_people, 6, 0)
    assert len(set(keys.values())) == len(keys)
    # What is no matter of the pool does not.
    changed = deepcopy(chair)
    changed.policy, changed.max_decisions = "explicit_query", 7
    assert module.pool_key(changed, chair_people, 6, 0) == keys["program"]


@pytest.mark.parametrize("damage", ["cut", "bit", "text", "another", "start"])
def test_a_damaged_file_is_made_again(chair, chair_people, folder, damage):
    pool = cached_pool(chair, chair_people, 4, 0)
    (path,) = folder.iterdir()
    data = bytearray(path.read_bytes())
    if damage == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif damage == "bit":
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    elif damage == "text":
        path.write_text("no pool")
    elif damage == "another":
        module._write_pool(path, pool, "another key")
    else:
        pool.phases.start[0, 0] += len(pool.phases.values)
        module._write_pool(path, pool, module.pool_key(chair, chair_people, 4, 0))
        pool.phases.start[0, 0] -= len(pool.phases.values)
    with pytest.warns(UserWarning, match=rf"{path.name}: damaged \(.*made again"):
        again = cached_pool(chair, chair_people, 4, 0)
    assert_equal(pool, again)
    assert_equal(pool, cached_pool(chair, chair_people, 4, 0))  # and without a warning now


def test_old_files_go(chair, chair_people, folder):
    for k in range(MAX_CACHED + 3):
        path = folder / f"pool_{k:02}.npz"
        path.touch()
        os.utime(path, (k, k))
    other = folder / "mine.npz"
    other.touch()
    cached_pool(chair, chair_people, 2, 0)
    names = sorted(path.name for path in folder.glob("pool_*"))
    assert len(names) == MAX_CACHED
    assert "pool_03.npz" not in names
    assert "pool_04.npz" in names
    assert other.exists()

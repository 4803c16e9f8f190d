"""Import, cache and load."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open

from apil_core import UnknownNameError, VictimError
from apil_core.policies import zoo as store
from apil_core.policies import zoo_cache as cache
from apil_core.policies import zoo_catalogue as catalogue
from apil_core.policies.zoo_layout import join, split, tensor_shapes

KICKER = "kick-and-defend/kicker/v1"
KICKER_FILE = "agent-zoo/kick-and-defend/kicker/agent1_parameters-v1.pkl"
BLOCKER = "you-shall-not-pass/blocker/v1"


def cached(home: Path) -> set[str]:
    return {str(path.relative_to(home)) for path in home.rglob("*") if path.is_file()}


def test_catalogue_has_every_agent() -> None:
    names = set(catalogue.entries())
    expected = {f"kick-and-defend/{side}/v{v}" for side in ("kicker", "defender") for v in (1, 2, 3)}
    expected |= {"you-shall-not-pass/blocker/v1", "you-shall-not-pass/runner/v1"}
    expected |= {f"sumo-humans/fighter/v{v}" for v in (1, 2, 3)}
    expected |= {f"sumo-ants/fighter/v{v}" for v in (1, 2, 3, 4)}
    expected |= {f"run-to-goal-{body}/runner_{i}/v1" for body in ("humans", "ants") for i in (0, 1)}
    assert names == expected
    seat = {"blocker": "agent1", "runner": "agent2"}
    for side, agent in seat.items():
        assert agent in catalogue.entries()[f"you-shall-not-pass/{side}/v1"].file


def test_pickle_size_fits_the_vector_length() -> None:
    for entry in catalogue.entries().values():
        floats = sum(int(np.prod(shape)) for shape in tensor_shapes(entry.facts).values())
        assert entry.size == 4 * floats + (161 if floats > 65535 else 159)  # numpy's own frame


def test_split_and_join() -> None:
    shapes = tensor_shapes(catalogue.GAMES["sumo-ants"])
    vector = np.arange(299_943, dtype=np.float32)
    parts = split(vector, shapes)
    assert {name: part.shape for name, part in parts.items()} == shapes
    np.testing.assert_array_equal(join(parts, shapes), vector)


@pytest.mark.parametrize("folder", [".", "agent-zoo"])
def test_import_from_folder_or_parent(made_up_zoo: Path, cache_home: Path, folder: str) -> None:
    before = store.list_zoo()
    assert not cache_home.exists()  # looking writes nothing
    assert not any(row.available for row in before)
    rows = store.import_zoo(made_up_zoo / folder)
    names = {
        "zoo:" + name for name in (KICKER, BLOCKER, "sumo-ants/fighter/v1", "run-to-goal-ants/runner_0/v1")
    }
    assert {row.name for row in rows} == names
    assert all(row.sha256 and not row.error for row in rows)
    assert {row.name for row in store.list_zoo() if row.available} == names
    assert cached(cache_home) == {f"zoo/{name.removeprefix('zoo:')}.safetensors" for name in names}


def test_upstreams_misnamed_file_may_have_been_mended(made_up_zoo: Path) -> None:
    folder = made_up_zoo / "agent-zoo" / "you-shall-not-pass"
    (folder / "agent1_parameters-v1pkl").rename(folder / "agent1_parameters-v1.pkl")
    assert f"zoo:{BLOCKER}" in {row.name for row in store.import_zoo(made_up_zoo)}


def test_import_again_and_load(made_up_zoo: Path) -> None:
    store.import_zoo(made_up_zoo)
    store.import_zoo(str(made_up_zoo))
    policy = store.load(KICKER)
    entry = catalogue.entries()[KICKER]
    assert policy.info.name == "zoo:kick-and-defend/kicker/v1"
    assert policy.info.sha256 == hashlib.sha256((made_up_zoo / KICKER_FILE).read_bytes()).hexdigest()
    assert (policy.info.observation_size, policy.info.action_size) == (384, 17)
    assert policy.info.provenance == {
        "repository": "github.com/openai/multiagent-competition",
        "commit": "b2e081a192429913b7d21a89525901d59c85e7f3",
        "file": KICKER_FILE,
    }
    listing = next(row for row in store.list_zoo() if row.name == entry.full_name)
    assert listing.sha256 == entry.sha256
    assert KICKER_FILE in listing.provenance


def test_cached_file_tells_where_it_comes_from(made_up_zoo: Path) -> None:
    store.import_zoo(made_up_zoo)
    entry = catalogue.entries()[BLOCKER]
    with safe_open(cache.cached_file(entry), framework="numpy") as file:
        metadata = file.metadata()
        assert "value.hidden_0.kernel" in file.keys()  # noqa: SIM118  (the file is no mapping)
    assert metadata.items() >= {
        ("name", "zoo:you-shall-not-pass/blocker/v1"),
        ("file", "agent-zoo/you-shall-not-pass/agent1_parameters-v1pkl"),
        ("pickle_sha256", entry.sha256),
        ("commit", entry.commit),
        ("repository", entry.repository),
        ("converter", "1"),
    }


def test_wrong_sum_is_refused_and_the_rest_imported(
    made_up_zoo: Path, cache_home: Path, damage: Callable[[Path, int], None]
) -> None:
    damage(made_up_zoo / KICKER_FILE, -500)
    actual = hashlib.sha256((made_up_zoo / KICKER_FILE).read_bytes()).hexdigest()
    with pytest.raises(VictimError) as caught:
        store.import_zoo(made_up_zoo)
    message = str(caught.value)
    assert "\n" not in message
    for part in (KICKER_FILE, actual, catalogue.entries()[KICKER].sha256):
        assert part in message
    assert isinstance(caught.value, store.ZooImportError)
    assert {row.name: bool(row.error) for row in caught.value.rows} == {
        "zoo:kick-and-defend/kicker/v1": True,
        "zoo:you-shall-not-pass/blocker/v1": False,
        "zoo:sumo-ants/fighter/v1": False,
        "zoo:run-to-goal-ants/runner_0/v1": False,
    }
    assert len(cached(cache_home)) == 3
    assert not (cache_home / "zoo" / "kick-and-defend").exists()
    assert caught.value.exit_code != 0


def test_wrong_sum_leaves_the_earlier_import(made_up_zoo: Path, damage: Callable[[Path, int], None]) -> None:
    store.import_zoo(made_up_zoo)
    damage(made_up_zoo / KICKER_FILE, -500)
    with pytest.raises(VictimError, match="not imported"):
        store.import_zoo(made_up_zoo)
    assert store.load(KICKER)


class Shell:
    """Fails the tests if it is unpickled."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return pytest.fail, ("a file of the zoo was unpickled",)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"<!DOCTYPE html>", "not a readable pickle"),
        (np.zeros(17, np.float32), "no float32 vector of 364839 values in it"),
        (np.linspace(1, 2, 364_839), "no float32 vector of 364839 values in it"),
        (Shell(), "no float32 vector of 364839 values in it"),
    ],
)
def test_known_sum_of_a_wrong_pickle(
    made_up_zoo: Path, monkeypatch: pytest.MonkeyPatch, content: object, named: str
) -> None:
    data = content if isinstance(content, bytes) else pickle.dumps(content, protocol=3)
    (made_up_zoo / KICKER_FILE).write_bytes(data)
    known = dict(catalogue.entries())
    known[KICKER] = replace(known[KICKER], sha256=hashlib.sha256(data).hexdigest())
    monkeypatch.setattr(catalogue, "entries", lambda: known)
    with pytest.raises(VictimError, match=named):
        store.import_zoo(made_up_zoo)
    with pytest.raises(VictimError, match="not on this machine"):
        store.load(KICKER)


@pytest.mark.parametrize("path", ["nowhere", "."])
def test_nothing_to_import(tmp_path: Path, path: str) -> None:
    with pytest.raises(VictimError, match="no agents of the zoo below"):
        store.import_zoo(tmp_path / path)


def test_missing_agent_says_how_to_get_it() -> None:
    with pytest.raises(VictimError) as caught:
        store.load(KICKER)
    message = str(caught.value)
    assert "zoo:kick-and-defend/kicker/v1" in message
    assert "`apil victims import DIR`" in message
    assert "`apil victims download`" in message
    assert "\n" not in message


def test_unknown_name_suggests() -> None:
    with pytest.raises(UnknownNameError, match=re.escape("did you mean 'zoo:kick-and-defend/kicker/v1'?")):
        store.load("kick-and-defend/kiker/v1")


@pytest.mark.parametrize("offset", [0, 9, 400, 3000, 700_000, -1])
def test_one_changed_bit_in_the_cache(
    made_up_zoo: Path, damage: Callable[[Path, int], None], offset: int
) -> None:
    store.import_zoo(made_up_zoo)
    damage(cache.cached_file(catalogue.entries()[KICKER]), offset)
    with pytest.raises(VictimError, match=r"kicker/v1.*damaged.*import or download it again") as caught:
        store.load(KICKER)
    assert "\n" not in str(caught.value)
    store.import_zoo(made_up_zoo)
    assert store.load(KICKER)


@pytest.mark.parametrize("length", [0, 5, 500, 100_000])
def test_truncated_cache(made_up_zoo: Path, length: int) -> None:
    store.import_zoo(made_up_zoo)
    path = cache.cached_file(catalogue.entries()[KICKER])
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(VictimError, match="damaged"):
        store.load(KICKER)


def test_one_agent_under_the_name_of_another(made_up_zoo: Path) -> None:
    store.import_zoo(made_up_zoo)
    defender = cache.cached_file(catalogue.entries()["kick-and-defend/defender/v1"])
    defender.parent.mkdir()
    shutil.copy(cache.cached_file(catalogue.entries()[KICKER]), defender)
    with pytest.raises(VictimError, match="damaged"):
        store.load("kick-and-defend/defender/v1")


def test_unwritable_cache(made_up_zoo: Path, cache_home: Path) -> None:
    cache_home.write_text("a file where the folder should be")
    with pytest.raises(VictimError, match="cannot write"):
        store.import_zoo(made_up_zoo)


def test_failed_write_leaves_no_trace(
    made_up_zoo: Path, cache_home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(VictimError, match="No space left on device"):
        store.import_zoo(made_up_zoo)
    assert cached(cache_home) == set()


def test_default_cache_is_the_users(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("APIL_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.cache_dir().name == "apil"


def test_real_zoo(zoo_dir: Path) -> None:
    for row in store.import_zoo(zoo_dir):
        assert store.load(row.name.removeprefix("zoo:")).info.sha256 == row.sha256


def test_shipped_sums_are_those_beside_the_real_zoo(zoo_dir: Path) -> None:
    beside = zoo_dir.parent / "checksums.json"
    if not beside.is_file():
        pytest.skip(f"no {beside}")
    published = json.loads(beside.read_text())["files"]
    assert {entry.file: entry.sha256 for entry in catalogue.entries().values()} == {
        file: sums["sha256"] for file, sums in published.items()
    }

"""A made-up zoo in upstream's layout, so that most tests need no real weights."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from apil_core.policies import zoo_catalogue as catalogue
from apil_core.policies.zoo_layout import vector_length
from policies.zoo_server import ZooServer, serving

Vectors = dict[str, NDArray[np.float32]]

COMMIT = "b2e081a192429913b7d21a89525901d59c85e7f3"

# one of each network, both robots, and the one that upstream misnames
MADE_UP = (
    "kick-and-defend/kicker/v1",
    "you-shall-not-pass/blocker/v1",
    "sumo-ants/fighter/v1",
    "run-to-goal-ants/runner_0/v1",
)


@pytest.fixture(autouse=True)
def cache_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("APIL_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def _vector(name: str, seed: int) -> NDArray[np.float32]:
    facts = catalogue.entries()[name].facts
    rng = np.random.default_rng(seed)
    vector = rng.normal(0, 0.1, vector_length(facts)).astype(np.float32)
    size, count = facts.observation_size, np.float32(1000)
    mean, variance = rng.normal(0, 1, 1 + size), rng.uniform(0, 2, 1 + size) ** 3
    sums, squares = mean * count, (variance + mean**2) * count
    vector[:3] = sums[0], squares[0], count
    vector[3 : 4 + 2 * size] = [*sums[1:], *squares[1:], count]
    return vector


@pytest.fixture(scope="session")
def vectors() -> Vectors:
    return {name: _vector(name, seed) for seed, name in enumerate(MADE_UP)}


@pytest.fixture
def made_up_zoo(tmp_path: Path, vectors: Vectors, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder that holds ``agent-zoo`` with the made-up agents; their sums pass for upstream's."""
    known = dict(catalogue.entries())
    for name, vector in vectors.items():
        data = pickle.dumps(vector, protocol=3)
        known[name] = replace(known[name], sha256=hashlib.sha256(data).hexdigest(), size=len(data))
        file = tmp_path / "upstream" / known[name].file
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
    monkeypatch.setattr(catalogue, "entries", lambda: known)
    return tmp_path / "upstream"


@pytest.fixture
def only_made_up(made_up_zoo: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The whole zoo is the four made-up agents; below a folder named like the pinned commit."""
    known = {n: entry for n, entry in catalogue.entries().items() if (made_up_zoo / entry.file).exists()}
    monkeypatch.setattr(catalogue, "entries", lambda: known)
    (made_up_zoo / COMMIT).mkdir()
    (made_up_zoo / "agent-zoo").rename(made_up_zoo / COMMIT / "agent-zoo")
    return made_up_zoo / COMMIT


@pytest.fixture
def server(only_made_up: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ZooServer]:
    """Serves the made-up agents."""
    for name in ("NO_PROXY", "no_proxy"):
        monkeypatch.setenv(name, "127.0.0.1")
    with serving(only_made_up.parent) as running:
        yield running


@pytest.fixture
def damage() -> Callable[[Path, int], None]:
    """Flip one bit of a file, ``offset`` bytes from its start (or end, if negative)."""

    def flip(file: Path, offset: int) -> None:
        content = bytearray(file.read_bytes())
        content[offset] ^= 1
        file.write_bytes(content)

    return flip

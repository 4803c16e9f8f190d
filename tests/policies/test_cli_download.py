"""``apil victims download`` as a user meets it: what it says, what it leaves, and what a second call does."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from cli.cli_helpers import Outcome, called

from apil_core.policies import zoo as store
from apil_core.policies import zoo_catalogue as catalogue
from policies.zoo_server import Fault, ZooServer

KICKER = "zoo:kick-and-defend/kicker/v1"
KICKER_FILE = "kicker/agent1_parameters-v1.pkl"

Download = Callable[..., Outcome]


@pytest.fixture
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary files go."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


@pytest.fixture
def download(capsys: pytest.CaptureFixture[str], scratch: Path) -> Download:
    """Call ``apil victims download ARGUMENTS`` in this process; nothing temporary may stay."""

    def call(*arguments: str) -> Outcome:
        done = called(capsys, "victims", "download", *arguments)
        assert list(scratch.iterdir()) == []
        return done

    return call


def here() -> set[str]:
    """Agents in the cache; each is loaded, which proves its checksum."""
    names = {row.name for row in store.list_zoo() if row.available}
    for name in names:
        store.load(name.removeprefix("zoo:"))
    return names


def everything() -> set[str]:
    return {entry.full_name for entry in catalogue.entries().values()}


def test_all_agents_come_and_a_second_call_asks_for_none(server: ZooServer, download: Download) -> None:
    done = download("--base-url", server.url)
    assert (done.code, done.err) == (0, "")
    assert done.out.count("  sha256 ") == 4
    assert done.out.endswith("4 victims imported\n")
    assert here() == everything()
    server.served.clear()
    again = download("--base-url", server.url)
    assert (again.code, again.out, again.err) == (0, "nothing to do: all are here already\n", "")
    assert server.served == []


def test_one_game_as_json(server: ZooServer, download: Download) -> None:
    done = download("--base-url", server.url, "--game", "sumo-ants", "--json")
    (row,) = json.loads(done.out)
    assert (done.code, row["name"], row["error"]) == (0, "zoo:sumo-ants/fighter/v1", "")
    assert here() == {"zoo:sumo-ants/fighter/v1"}


@pytest.mark.parametrize("as_json", [False, True])
def test_a_wrong_checksum(
    server: ZooServer,
    download: Download,
    only_made_up: Path,
    damage: Callable[[Path, int], None],
    as_json: bool,
) -> None:
    damage(only_made_up / "agent-zoo" / "kick-and-defend" / KICKER_FILE, -500)
    done = download("--base-url", server.url, *(["--json"] if as_json else []))
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert KICKER_FILE in done.err
    assert f"expected sha256:{catalogue.entries()[KICKER.removeprefix('zoo:')].sha256} but got " in done.err
    assert KICKER not in done.out
    if as_json:
        assert {row["name"] for row in json.loads(done.out)} == everything() - {KICKER}
    assert here() == everything() - {KICKER}


@pytest.mark.parametrize(
    ("fault", "reason", "the_rest_came"),
    [
        ("error", "(HTTP 500)", True),
        ("half", "(ChunkedEncodingError)", False),  # whoever breaks off is not asked again
        ("hang up", "(ConnectionError)", False),
    ],
)
def test_a_server_with_a_fault_and_then_without(
    server: ZooServer, download: Download, fault: Fault, reason: str, the_rest_came: bool
) -> None:
    server.faults[KICKER_FILE] = fault
    done = download("--base-url", server.url)
    assert done.code == 2
    assert done.err.startswith("apil: cannot download http://127.0.0.1:")
    assert f"{KICKER_FILE} {reason}" in done.err
    assert "`apil victims import DIR`" in done.err
    assert done.err.count("\n") == 1
    assert here() == (everything() - {KICKER} if the_rest_came else set())
    server.faults.clear()
    assert download("--base-url", server.url).code == 0
    assert here() == everything()


def test_a_file_the_server_does_not_have(server: ZooServer, download: Download, only_made_up: Path) -> None:
    (only_made_up / "agent-zoo" / "kick-and-defend" / KICKER_FILE).unlink()
    done = download("--base-url", server.url)
    assert done.code == 2
    assert f"{KICKER_FILE} (HTTP 404)" in done.err
    assert here() == everything() - {KICKER}


def test_a_server_that_goes_away_midway_and_what_the_next_call_fetches(
    server: ZooServer, download: Download
) -> None:
    server.patience = 2
    done = download("--base-url", server.url)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert done.out.count("  sha256 ") == 2
    assert len(here()) == 2
    assert len(server.served) == 3  # the third broke off, nobody asked for the fourth
    came = here()
    server.patience = None
    server.served.clear()
    again = download("--base-url", server.url)
    assert again.code == 0
    assert again.out.endswith("2 victims imported\n")
    assert len(server.served) == 2
    assert here() == everything() > came


def test_no_server_at_all(download: Download, only_made_up: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with socket.socket() as closed:  # bound but not listening: connections are refused
        closed.bind(("127.0.0.1", 0))
        done = download("--base-url", f"http://127.0.0.1:{closed.getsockname()[1]}/")
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1
    assert "(ConnectionError); without network, take a copy of upstream's agent-zoo" in done.err
    assert here() == set()


def test_an_unknown_game(download: Download) -> None:
    done = download("--game", "sumo-ant")
    assert (done.code, done.out) == (2, "")
    assert "did you mean 'sumo-ants'" in done.err

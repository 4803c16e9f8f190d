"""Download from a server on this machine."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable
from pathlib import Path

import pooch
import pytest

from apil_core import UnknownNameError, VictimError
from apil_core.policies import zoo as store
from apil_core.policies import zoo_cache as cache
from apil_core.policies import zoo_catalogue as catalogue
from policies.conftest import COMMIT
from policies.zoo_server import ZooServer

KICKER = "kick-and-defend/kicker/v1"
ANTS = ["sumo-ants", "run-to-goal-ants"]


@pytest.fixture(autouse=True)
def direct(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("no_proxy", "127.0.0.1")


def test_whole_zoo(server: ZooServer, capsys: pytest.CaptureFixture[str]) -> None:
    level = pooch.get_logger().level
    rows = store.download_zoo(base_url=server.url)
    assert {row.name for row in rows} == {f"zoo:{name}" for name in catalogue.entries()}
    for row in rows:
        assert store.load(row.name.removeprefix("zoo:")).info.sha256 == row.sha256
        assert row.source.startswith(server.url.format(commit=COMMIT) + "agent-zoo/")
    assert capsys.readouterr() == ("", "")
    assert pooch.get_logger().level == level
    assert level != logging.WARNING


def test_only_what_is_missing_or_damaged(server: ZooServer, damage: Callable[[Path, int], None]) -> None:
    store.download_zoo(base_url=server.url)
    server.served.clear()
    assert store.download_zoo(base_url=server.url) == []
    assert server.served == []
    damage(cache.cached_file(catalogue.entries()[KICKER]), -1)
    assert [row.name for row in store.download_zoo(base_url=server.url)] == [f"zoo:{KICKER}"]
    assert len(server.served) == 1


def test_chosen_games_and_a_base_without_slash(server: ZooServer) -> None:
    rows = store.download_zoo(games=ANTS, base_url=server.url.rstrip("/").format(commit=COMMIT))
    assert {row.name for row in rows} == {"zoo:sumo-ants/fighter/v1", "zoo:run-to-goal-ants/runner_0/v1"}
    assert len(server.served) == 2


def test_unknown_game() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'sumo-ants'"):
        store.download_zoo(games=["sumo-ant"])


def test_wrong_sum(server: ZooServer, only_made_up: Path, damage: Callable[[Path, int], None]) -> None:
    damage(only_made_up / catalogue.entries()[KICKER].file, -500)
    with pytest.raises(VictimError) as caught:
        store.download_zoo(base_url=server.url)
    message = str(caught.value)
    assert "\n" not in message
    assert catalogue.entries()[KICKER].file in message
    assert f"expected sha256:{catalogue.entries()[KICKER].sha256} but got " in message
    assert isinstance(caught.value, store.ZooImportError)
    assert sum(not row.error for row in caught.value.rows) == 3
    assert sum(row.available for row in store.list_zoo()) == 3


def test_file_missing_on_the_server(server: ZooServer, only_made_up: Path) -> None:
    (only_made_up / catalogue.entries()[KICKER].file).unlink()
    with pytest.raises(VictimError, match=r"kicker/agent1_parameters-v1.pkl \(HTTP 404\)"):
        store.download_zoo(base_url=server.url)
    assert sum(row.available for row in store.list_zoo()) == 3


def test_no_network(only_made_up: Path, cache_home: Path) -> None:
    with socket.socket() as closed:  # bound but not listening: connections are refused
        closed.bind(("127.0.0.1", 0))
        with pytest.raises(VictimError) as caught:
            store.download_zoo(base_url=f"http://127.0.0.1:{closed.getsockname()[1]}/")
    message = str(caught.value)
    assert "\n" not in message  # one line, not one per file
    assert "cannot download http://127.0.0.1:" in message
    assert "`apil victims import DIR`" in message
    assert not cache_home.exists()


@pytest.mark.parametrize("base_url", ["not-a-url", "smtp://127.0.0.1/"])
def test_unusable_base_url(only_made_up: Path, base_url: str) -> None:
    with pytest.raises(VictimError) as caught:
        store.download_zoo(base_url=base_url)
    assert base_url.rstrip("/") in str(caught.value)

"""The pytest plugin in a session of its own, and the addresses that messages name."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from docs.pages import ROOT, anchors

from apil_core.api.hookspecs import ProcessHooks, RunHooks
from apil_core.testing import check_game, check_method, check_victim, tiny_config
from apil_core.testing.checks import GAME_CHECKS, METHOD_CHECKS, VICTIM_CHECKS, hook_address

TESTS = """
import sys


def test_the_plugin_is_light(apil_tiny_run):
    assert callable(apil_tiny_run)
    assert not {"torch", "mujoco"} & set(sys.modules)
"""

PLAIN = """
from apil_core import Method, MethodSpec, hookimpl


class Plain(Method):
    pass


@hookimpl
def register_methods():
    return [MethodSpec("plain_of_a_test", f"{__name__}:Plain")]
"""


def test_fixtures_in_a_session_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text(TESTS)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "--rootdir",
        ".",
        "test_mine.py",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "1 passed" in done.stdout, done.stdout + done.stderr


def test_a_tiny_run_of_a_file(apil_tiny_run, tmp_path: Path) -> None:
    (tmp_path / "plain_of_a_test.py").write_text(PLAIN)
    first = apil_tiny_run("plain_of_a_test", plugins=[tmp_path / "plain_of_a_test.py"], steps=512)
    second = apil_tiny_run(tiny_config("adrl"), steps=512)
    assert (first.status, first.steps) == (second.status, second.steps) == ("finished", 512)
    assert first.run_dir != second.run_dir


def test_its_file_is_forgotten() -> None:
    assert "plain_of_a_test" not in sys.modules


def test_the_fixtures_are_the_functions(apil_check_method, apil_check_game, apil_check_victim) -> None:
    assert (apil_check_method, apil_check_game, apil_check_victim) == (check_method, check_game, check_victim)


CHECKS = [*METHOD_CHECKS.values(), *GAME_CHECKS.values(), *VICTIM_CHECKS.values()]


@pytest.mark.parametrize("page", ["testing.md", "hooks.md"])
def test_every_address_in_a_message_leads_somewhere(page: str) -> None:
    hooks = [n for place in (RunHooks, ProcessHooks) for n in vars(place) if not n.startswith("_")]
    addresses = [*(p.address for p in CHECKS), *map(hook_address, hooks), hook_address("anothers_hook")]
    named = {a.partition("#")[2] for a in addresses if a.startswith(page)}
    assert named
    assert named <= anchors(ROOT / "docs" / page)


def test_titles_differ() -> None:
    assert len({check.title for check in CHECKS}) == len(CHECKS)

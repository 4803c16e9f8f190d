"""The tutorials do what they say: every change fits its file, every command runs, in the order of the page.

Twice: in this process with tiny budgets (default; not the quickstart: other tests run its commands),
and as printed, in an environment of its own (slow).
"""

from __future__ import annotations

import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from docs.conftest import Apil
from docs.following import changed, follow, own_environment
from docs.pages import ROOT, blocks

FOLDER = ROOT / "docs" / "tutorial"
PAGES = sorted(FOLDER.glob("*.md"))
KINDS = ("write", "change", "shell", "console")

QUICK = {
    **{"steps": "512", "num_envs": "16", "ppo.num_steps": "16", "threads": "1"},
    **{"evaluation.episodes": "2", "recorders": "[jsonl]"},
}
FEWER = {
    "run": (*(word for item in QUICK.items() for word in ("--set", "=".join(item))), "--quiet"),
    "eval": ("--episodes", "4", "--quiet"),
}
"""What the default run adds to a verb: it changes how long, not what. ``--set`` outranks flags."""

SLOW_ONLY = (["bench"], ["play"], ["crossplay"])
"""Commands that start processes of their own, or draw."""


def name_of(page: Path) -> str:
    return page.stem


def test_there_is_something_to_follow() -> None:
    assert {page.stem for page in PAGES} == {
        "quickstart",
        "write-an-attack",
        "bring-a-game",
        "bring-a-victim",
    }
    for page in PAGES:
        assert blocks(page, "shell"), page
        assert {block.kind for block in blocks(page) if block.kind} <= {*KINDS}


def test_the_attack_is_some_twenty_lines() -> None:
    """As its heading says: of the method, comments and docstrings included."""
    method = [
        b for b in blocks(FOLDER / "write-an-attack.md", "change") if b.arguments[0].endswith("method.py")
    ]
    added = sum(
        line.startswith("+") and len(line) > 1 for block in method for line in block.text.splitlines()
    )
    assert 15 <= added <= 22


def test_a_change_that_does_not_fit_is_told() -> None:
    assert changed("a\nb\nc\n", " a\n-b\n+d\n") == "a\nd\nc\n"
    for text in ("a\nc\n", "a\nb\na\nb\n"):
        with pytest.raises(AssertionError, match="not there, or more than once"):
            changed(text, " a\n-b\n+d\n")


_SMALL = [
    # a game and a victim are written by the tests of `apil new` as well
    pytest.param(page, id=name_of(page), marks=[] if page.stem == "write-an-attack" else pytest.mark.slow)
    for page in PAGES
    if page.stem != "quickstart"
]


@pytest.mark.parametrize("page", _SMALL)
def test_a_tutorial_works_in_small(
    apil: Apil, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, page: Path
) -> None:
    site = tmp_path / "site-packages"
    monkeypatch.syspath_prepend(str(site))

    def shell(command: str) -> None:
        program, *arguments = shlex.split(command)
        if program == "python" and arguments[:3] == ["-m", "pip", "install"]:
            install(tmp_path / arguments[-1].partition("[")[0], site, monkeypatch)
        elif program == "python" and arguments[0].endswith(".py"):
            monkeypatch.setattr(sys, "argv", arguments)
            runpy.run_path(arguments[0], run_name="__main__")
        elif program == "apil" and not any(arguments[: len(verb)] == verb for verb in SLOW_ONLY):
            monkeypatch.setattr(
                "apil_core.plugins.registry._default", None
            )  # what is installed changes on the way
            added = FEWER.get(arguments[0], ())
            done = apil(*(word for word in arguments if word != "--show"), *added)
            assert done.code == 0, f"{command}\n{done.out}{done.err}"

    follow(page, tmp_path, shell)


def install(project: Path, site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What ``pip install -e`` leaves behind, and the package's own tests but for the conformance suite."""
    name = project.name
    told = site / f"apil_{name}-0.1.0.dist-info"
    told.mkdir(parents=True)
    (told / "METADATA").write_text(f"Metadata-Version: 2.1\nName: apil-{name}\nVersion: 0.1.0\n")
    points = re.search(
        r"^\[project\.entry-points\.apil\]\n(.*)$", (project / "pyproject.toml").read_text(), re.M
    )
    assert points
    (told / "entry_points.txt").write_text(f"[apil]\n{points[1].replace(chr(34), '')}\n")
    monkeypatch.syspath_prepend(str(project))
    namespace: dict[str, object] = {}
    exec(compile((project / "tests" / f"test_{name}.py").read_text(), f"test_{name}.py", "exec"), namespace)
    by_hand = [key for key in namespace if key.startswith("test_") and "every_check" not in key]
    assert by_hand
    for key in by_hand:
        namespace[key]()  # type: ignore[operator]


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_a_tutorial_works_as_printed(tmp_path: Path, page: Path) -> None:
    work = tmp_path / "work"
    work.mkdir()
    own = own_environment(tmp_path)

    def shell(command: str) -> None:
        done = subprocess.run(
            command, shell=True, cwd=work, env=own, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"

    follow(page, work, shell)

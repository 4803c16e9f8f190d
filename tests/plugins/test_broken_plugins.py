"""What a user sees of a broken plugin is what docs/broken-plugins.md says, line for line."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from cli.cli_helpers import called
from docs.pages import ROOT, sections

from plugins.broken_plugins import SECTIONS, Case

PAGE = ROOT / "docs" / "broken-plugins.md"
ROW = re.compile(r"^\| (?P<mistake>[^|]+?) \| `(?P<line>[^|]+)` \|$", flags=re.MULTILINE)


def tiny(title: str) -> tuple[str, ...]:
    """Flags of the smallest run that shows the mistake."""
    games, steps = ("40", "2k") if title == "fails at step 1000" else ("4", "64")
    score = "2" if "evaluation" in title else "0"
    return (
        *("--env", "toy-pursuit", "--num-envs", games, "--steps", steps, "--threads", "1", "--out", "out"),
        *("--set", "ppo.num_steps=8", "--set", "ppo.epochs=1", "--set", "ppo.minibatches=1"),
        *("--set", "recorders=[jsonl]", "--set", "ppo.hidden=[8]", "--set", "checkpoint.every_iterations=1"),
        *("--set", f"evaluation.episodes={score}"),
    )


CASES = [pytest.param(title, case, id=title) for rows in SECTIONS.values() for title, case in rows.items()]


def shown() -> dict[str, dict[str, str]]:
    """Section of the page → mistake → the line one sees."""
    return {
        title: {row["mistake"]: row["line"] for row in ROW.finditer(text)}
        for title, text in sections(PAGE).items()
    }


@pytest.fixture
def printed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forgotten: None
) -> Callable[..., tuple[int, list[str]]]:
    """Call ``apil ARGUMENTS`` in an empty directory; exit code and lines of both streams."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("APIL_STRICT_PLUGINS", raising=False)

    def call(*arguments: str) -> tuple[int, list[str]]:
        done = called(capsys, *arguments)
        text = (done.out + done.err).replace(str(tmp_path), "/home/you")
        return done.code, [line.rstrip() for line in text.splitlines()]

    return call


def install(folder: Path, name: str) -> None:
    """What pip leaves of a distribution ``bad`` whose entry point ``name`` is the module ``bad``."""
    information = folder / "bad-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: bad\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(f"[apil]\n{name} = bad\n")


@pytest.mark.parametrize("section", SECTIONS)
def test_the_page_has_a_row_for_every_mistake_tried_here(section: str) -> None:
    assert list(shown()[section]) == list(SECTIONS[section])


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a file nobody closes
@pytest.mark.filterwarnings("ignore::apil_core.api.hook_api.HookDeprecationWarning")
@pytest.mark.parametrize(("title", "case"), CASES)
def test_one_sees_what_the_page_says(
    printed: Callable[..., tuple[int, list[str]]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    title: str,
    case: Case,
) -> None:
    (tmp_path / case.file).write_text(case.source)
    if case.installed:
        install(tmp_path, case.installed)
        monkeypatch.syspath_prepend(str(tmp_path))
    flags = tiny(title) if case.command[0] == "run" else ()
    code, lines = printed(*case.command, *flags)
    (expected,) = [rows[title] for rows in shown().values() if title in rows]
    if expected.endswith("…"):
        assert any(line.startswith(expected[:-1]) for line in lines), lines
    else:
        assert expected in [re.sub(r" \(/home/you/bad\.py:\d+\)$", "", line) for line in lines]
    if " failed in " in expected and "state_dict" not in title:  # which is no hook
        assert any(re.search(r" \(/home/you/bad\.py:\d+\)$", line) for line in lines)
    assert code == case.code
    assert not any("Traceback" in line for line in lines)
    if code == 2:
        assert len([line for line in lines if line.startswith("apil: ")]) == 1


def test_a_late_failure_says_how_to_go_on(
    printed: Callable[..., tuple[int, list[str]]], tmp_path: Path
) -> None:
    title = "fails at step 1000"
    (tmp_path / "bad.py").write_text(SECTIONS["Later"][title].source)
    _, lines = printed("run", "--plugin", "bad.py", "--method", "bad", *tiny(title))
    after = "stopped after 3 whole iterations by an error"
    assert f"{after}; continue from the last checkpoint with: apil resume out" in lines

"""What the documents say is so: code runs, commands and flags exist, links lead somewhere."""

from __future__ import annotations

import contextlib
import io
import os
import re
import runpy
import shlex
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
from cli.cli_helpers import VERBS

from apil_core.cli.app import make_app
from docs.conftest import Apil
from docs.pages import (
    FIRST_STEPS,
    HOOKS,
    INDEX,
    README,
    ROOT,
    Block,
    anchors,
    blocks,
    commands,
    links,
    pages,
    prose,
    spans,
)
from speed.__main__ import main as speed

TOY = ("--env", "toy-pursuit")
TINY = (
    *("--steps", "1k", "--num-envs", "16", "--threads", "1", "--quiet"),
    *("--set", "ppo.num_steps=16", "--set", "ppo.epochs=1", "--set", "evaluation.episodes=4"),
)

GROUPS = (("runs",), ("config",), ("victims",), ("bench",), ("analyze",), ("new",))

HELP: dict[tuple[str, ...], str] = {}
"""What ``apil … --help`` prints, asked once for all pages."""

METHOD = """\
from apil_core import Method, MethodSpec, hookimpl


class Example(Method):
{body}

@hookimpl
def register_methods():
    return [MethodSpec("example", f"{{__name__}}:Example", requires={requires!r})]
"""


def marked(kind: str) -> list[Block]:
    return [block for page in pages() for block in blocks(page, kind)]


def by_page(kind: str) -> list[Path]:
    return sorted({block.page for block in marked(kind)})


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


# --- code


def test_the_readme_the_first_steps_and_the_hook_reference_have_examples_to_run() -> None:
    assert blocks(README, "plugin")
    assert blocks(FIRST_STEPS, "python")
    assert blocks(HOOKS, "plugin")
    assert blocks(HOOKS, "method")


@pytest.mark.parametrize("block", marked("plugin"), ids=str)
def test_plugins_shown_in_the_documents_run(apil: Apil, tmp_path: Path, block: Block) -> None:
    first = block.text.split("\n")[0]
    file = tmp_path / first.removeprefix("# ").split(":")[0].strip()
    assert file.suffix == ".py", f"{block}: the first line must be a comment with the file's name"
    file.write_text(block.text)
    game = () if "--env" in block.arguments else TOY
    done = apil("run", *TINY, *game, "--plugin", file, *block.arguments, "--out", "out")
    assert done.code == 0, done.err
    assert apil("eval", "out", "--episodes", "2", "--quiet").code == 0


def test_the_readmes_plugin_does_what_the_readme_says(apil: Apil, tmp_path: Path) -> None:
    (block,) = blocks(README, "plugin")
    (tmp_path / "restless.py").write_text(block.text)
    flags = ("--plugin", "restless.py", "--method", "restless", "--set", "options.restless.weight=0.1")
    assert apil("run", *TINY, *TOY, *flags, "--out", "out").code == 0
    metrics = (tmp_path / "out" / "metrics.jsonl").read_text()
    assert '"reward/restless_victim"' in metrics
    assert '"reward/minus_victim"' in metrics
    assert apil("resume", "out", "--steps", "2k", "--quiet").code == 0


def test_the_diary_saw_the_whole_run(apil: Apil, tmp_path: Path) -> None:
    (block,) = (block for block in blocks(HOOKS, "plugin") if "diary" in block.text)
    (tmp_path / "diary.py").write_text(block.text)
    assert apil("run", *TINY, *TOY, "--plugin", "diary.py", *block.arguments, "--out", "out").code == 0
    notes = (tmp_path / "diary.txt").read_text().splitlines()
    assert [note.split()[0] for note in notes] == ["started", *["iteration"] * 4, "won", "finished"]


@pytest.mark.parametrize("block", marked("method"), ids=str)
def test_hooks_shown_without_their_class_run(apil: Apil, tmp_path: Path, block: Block) -> None:
    body = "".join(f"    {line}\n" if line else "\n" for line in block.text.splitlines())
    (tmp_path / "example.py").write_text(METHOD.format(body=body, requires=block.arguments))
    done = apil("run", *TINY, *TOY, "--plugin", "example.py", "--method", "example", "--out", "out")
    assert done.code == 0, done.err


@pytest.mark.parametrize("block", marked("python"), ids=str)
def test_python_shown_in_the_documents_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: Block
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("example.py").write_text(block.text)  # TorchScript, for one, wants to read its source
    runpy.run_path("example.py", run_name="__main__")


@pytest.mark.parametrize("page", by_page("console"), ids=name_of)
def test_what_commands_print_is_what_the_documents_show(apil: Apil, tmp_path: Path, page: Path) -> None:
    for block in blocks(page, "file"):
        (tmp_path / block.arguments[0]).write_text(block.text)
    for block in blocks(page, "console"):
        for shown in block.text.removeprefix("$ ").split("\n$ "):
            command, _, expected = shown.partition("\n")
            done = apil(*shlex.split(command)[1:])
            printed = _tidy(done.out + done.err)
            assert _fits(printed, _tidy(expected)), f"{block}: {command} prints {printed}"


def _fits(printed: list[str], shown: list[str]) -> bool:
    """Equal, where ``…`` stands for what depends on the machine: a list of installed plugins."""
    patterns = [re.escape(line).replace("…", ".*") for line in shown]
    return len(printed) == len(shown) and all(map(re.fullmatch, patterns, printed))


def _tidy(text: str) -> list[str]:
    return [line.rstrip() for line in text.splitlines() if line.strip()]


# --- commands and flags


def help_of(apil: Apil, *chain: str) -> str:
    if chain not in HELP:
        HELP[chain] = apil(*chain, "--help").out
    return HELP[chain]


@cache
def speed_help() -> str:
    with contextlib.redirect_stdout(io.StringIO()) as text:
        assert not speed(["--help"])
    return text.getvalue()


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_every_command_exists_and_has_the_flags_shown(apil: Apil, page: Path) -> None:
    app = make_app()
    for words in commands(page):
        if words[0].startswith("-"):
            continue
        chain, _, rest = app.parse_commands(words)
        misses_sub_verb = chain[:1] in GROUPS and len(chain) == 1 and rest
        exists = chain and not misses_sub_verb
        assert exists, f"apil {' '.join(words)}: there is no such verb"
        for flag in (word.split("=")[0] for word in rest if word.startswith("--")):
            assert f"{flag} " in help_of(apil, *chain), f"apil {' '.join(words)}: no flag {flag}"


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_the_speed_benchmark_has_the_flags_shown(page: Path) -> None:
    for words in commands(page, "python -m benchmarks.speed"):
        for flag in (word.split("=")[0] for word in words if word.startswith("--")):
            assert f"{flag} " in speed_help(), f"python -m benchmarks.speed: no flag {flag}"


def test_the_readme_names_every_verb(apil: Apil) -> None:
    named = {words[0] for words in commands(README)}
    for verb in VERBS:
        assert verb in named


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_flags_named_alone_belong_to_some_verb(apil: Apil, page: Path) -> None:
    verbs = (
        "run",
        "resume",
        "eval",
        "play",
        "fidelity",
        "runs plot",
        "config schema",
        "config show",
        "victims list",
        "victims download",
        "doctor",
        "distill",
        "export",
        "victims check",
        "bench run",
        "bench report",
        "retrain",
        "crossplay",
        "tune",
        "analyze activations",
        "new victim",
    )
    for span in spans(page):
        if span.startswith("--"):
            text = speed_help() + "".join(help_of(apil, *verb.split()) for verb in ("", *verbs))
            assert f"{span.split()[0].split('=')[0]} " in text, f"{span}: no verb has this flag"


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_make_targets_named_in_the_documents_exist(page: Path) -> None:
    makefile = (ROOT / "Makefile").read_text()
    shell = [line for b in blocks(page) if b.language == "sh" for line in b.text.splitlines()]
    for code in [*shell, *spans(page)]:
        words = code.split()
        if words[:1] == ["make"] and len(words) > 1:
            assert f"\n{words[1]}:" in makefile, f"make {words[1]}: no such target"


# --- links


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_relative_links_lead_somewhere(page: Path) -> None:
    for target in links(page):
        if target.startswith(("http://", "https://")):
            continue
        path, _, anchor = target.partition("#")
        file = Path(os.path.normpath(page.parent / path)) if path else page
        assert file.exists(), f"{target}: no such file"
        if file.suffix != ".svg":  # a picture's fragment says for which colours it is
            assert not anchor or anchor in anchors(file), f"{target}: no such heading"


def test_every_page_of_docs_is_in_the_index_and_that_in_the_readme() -> None:
    assert str(INDEX.relative_to(ROOT)) in links(README)
    for page in (ROOT / "docs").rglob("*.md"):
        assert page == INDEX or str(page.relative_to(INDEX.parent)) in links(INDEX), page


def test_the_readme_is_for_a_stranger() -> None:
    assert len(README.read_text("utf-8").splitlines()) <= 150
    assert "![" in README.read_text("utf-8").split("##")[0], "a picture comes before anything else"
    assert "{{" not in README.read_text("utf-8"), "a number that still has to be measured"
    first = next(block for block in blocks(README) if block.language == "sh")
    assert [line.split()[:2] for line in first.text.splitlines()] == [["make", "run"], ["make", "test"]]


def test_the_citation_names_every_cited_paper() -> None:
    from ruamel.yaml import YAML

    cited = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert cited["cff-version"] == "1.2.0"
    bibtex = (ROOT / "docs" / "citing.md").read_text("utf-8")
    assert len(cited["references"]) == bibtex.count("@inproceedings") == 9
    for paper in cited["references"]:
        assert f"{{{paper['title']}}}" in bibtex
        assert paper["authors"][0]["family-names"] in bibtex


# --- make


def printed_by_make(*words: str) -> list[str]:
    """What ``make -n`` would run, with an environment that is there already."""
    command = ["make", "--no-print-directory", "-n", "-o", "nowhere/.ready", "VENV=nowhere", *words]
    environment = {key: value for key, value in os.environ.items() if key not in ("ZOO", "STEPS", "FLAGS")}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.mark.skipif(shutil.which("make") is None, reason="no make here")
def test_make_run_imports_nothing_unless_told_to() -> None:
    (alone,) = printed_by_make("run")
    assert alone.startswith("nowhere/bin/apil run --method e_apil --env kick-and-defend ")
    assert "--show" in alone.split()
    assert printed_by_make("run", "ZOO=/my zoo") == ['nowhere/bin/apil victims import "/my zoo"', alone]
    assert printed_by_make("run", "FLAGS=--seed 3")[0].split()[-2:] == ["--seed", "3"]


def test_every_method_has_its_page() -> None:
    from apil_core.plugins.discovery import discover

    for name in discover().methods:
        if (ROOT / "plugins" / name).is_dir():
            assert f"plugins/{name}/README.md" in prose(README)
        else:  # installed from examples/
            assert f"../examples/{name}/README.md" in prose(ROOT / "docs" / "README.md")


@pytest.mark.parametrize("name", ["apl", "apil", "e_apil"])
def test_every_option_of_a_method_stands_on_its_page(name: str) -> None:
    from apil_core.api.specs import load
    from apil_core.config.resolve import flatten
    from apil_core.plugins.discovery import discover

    page = ROOT / "plugins" / name / "README.md"
    defaults = flatten(load(str(discover().methods[name].config))().model_dump(mode="json"))
    rows = [line for line in prose(page).splitlines() if line.startswith("|")]
    for key, default in defaults.items():
        assert any(f"`{key}`" in row and _shown(default) in row for row in rows), f"{key} = {_shown(default)}"


def _shown(value: object) -> str:
    if value is None:
        return "`null`"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"

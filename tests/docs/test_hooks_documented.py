"""Every hook has its section, its arguments explained, an example and somebody who fills it."""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from functools import cache
from types import FunctionType

import pytest

from apil_core import Deprecation, hookspec
from docs.pages import HOOKS, ROOT, blocks, pages, sections

sys.path.insert(0, str(ROOT / "docs"))
import make_hooks
from make_hooks import hooks

GENERAL = {"Hooks of your own", "White box"}
"""Sections of the reference that are about no hook."""


def arguments(function: FunctionType) -> list[str]:
    return [name for name in inspect.signature(function).parameters if name != "self"]


@cache
def filled() -> set[str]:
    """Names of functions marked as hook implementations, in our sources, tests and tested examples."""
    folders = ("apil_core", "envs", "plugins", "examples", "tests")
    sources = [path.read_text("utf-8") for folder in folders for path in (ROOT / folder).rglob("*.py")]
    shown = [block.text for page in pages() for kind in ("plugin", "method") for block in blocks(page, kind)]
    functions = [
        node
        for source in [*sources, *shown]
        if "hookimpl" in source
        for node in ast.walk(ast.parse(textwrap.dedent(source)))
        if isinstance(node, ast.FunctionDef)
    ]
    return {f.name for f in functions if any("hookimpl" in ast.dump(mark) for mark in f.decorator_list)}


def test_there_are_hooks() -> None:
    assert {"register_methods", "shape_reward", "imitation_reward"} <= hooks().keys()


@pytest.mark.parametrize("name", hooks())
def test_a_hook_has_its_section(name: str) -> None:
    assert f"\n## `{name}`\n" in HOOKS.read_text("utf-8")


@pytest.mark.parametrize("name", hooks())
def test_its_section_names_every_argument_and_has_an_example(name: str) -> None:
    text = sections(HOOKS)[name]
    for argument in arguments(hooks()[name]):
        assert f"`{argument}`" in text, f"{name}: {argument} is not explained"
    by_hand = text.partition(make_hooks.END)[2]
    assert f"def {name}(" in by_hand, f"{name}: no example"
    assert ("*firstresult*" in text) == bool(hooks()[name].apil_spec["firstresult"])


@pytest.mark.parametrize("name", hooks())
def test_somebody_fills_it(name: str) -> None:
    assert name in filled()


def test_the_made_parts_are_what_the_script_makes() -> None:
    page = HOOKS.read_text("utf-8")
    assert make_hooks.written(page) == page, "run: python docs/make_hooks.py"


def test_a_made_part_tells_all_there_is_to_tell() -> None:
    made = sections(HOOKS)["combine_advantages"].partition(make_hooks.END)[0].splitlines()
    (shown,) = [line for line in made if line.startswith("def ")]
    assert shown.startswith("def combine_advantages(run: Run, rollout: Rollout, streams: dict[str, Tensor]")
    rows = [line.split("|")[1].strip() for line in made if line.startswith("| ") and line != "| | |"]
    asked = ["`run`", "`rollout`", "`streams`"]
    assert rows == ["what for", "when", *asked, "returns", "several answers", "since"]
    (users,) = [line for line in made if line.startswith("Used by: ")]
    assert "`apl`" in users


def test_an_end_that_was_announced_stands_in_the_table() -> None:
    @hookspec(since=1, deprecated=Deprecation(since=2, removed_in=3, instead="fill other"))
    def old(run: object) -> None:
        """Do what was done.

        When: never.

        Args:
            run: the run.
        """

    assert dict(make_hooks.facts(old))["deprecated"] == "since hook API 2, gone in 3: fill other"


def test_no_section_is_about_a_hook_that_is_gone() -> None:
    assert set(sections(HOOKS)) - GENERAL == set(hooks())


@pytest.mark.parametrize("block", [b for b in blocks(HOOKS) if b.language == "python"], ids=str)
def test_examples_take_arguments_the_hook_has(block: object) -> None:
    for node in ast.walk(ast.parse(block.text)):  # type: ignore[attr-defined]
        if isinstance(node, ast.FunctionDef) and node.name in hooks():
            taken = {argument.arg for argument in node.args.args} - {"self"}
            assert taken <= set(arguments(hooks()[node.name])), f"{block}: {node.name}"

"""Writes the tables of ``docs/hooks.md`` from the hook specifications and from who fills them.

    python docs/make_hooks.py

Signatures, versions, moments, arguments and answers come from ``apil_core/api/hookspecs.py`` and from the
hooks that methods open; the users from the sources of the core, the built-in plugins and the examples,
which are parsed, not imported. What stands between the two marker comments below each hook's heading is
replaced; all else is written by hand.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType

import docstring_parser

import apil_apil.hookspecs
from apil_core.api.hooks import life_of
from apil_core.api.hookspecs import ProcessHooks, RunHooks

HERE = Path(__file__).parent
ROOT = HERE.parent
PAGE = HERE / "hooks.md"
BEGIN, END = "<!-- made by make_hooks.py -->", "<!-- end of what make_hooks.py made -->"

PLACES = (ProcessHooks, RunHooks, apil_apil.hookspecs)
"""Where hooks are specified."""

_NO_USERS = {"scaffold", "testing", "tests", "templates"}
"""Folders whose sources fill hooks for others."""


def hooks() -> dict[str, FunctionType]:
    """Every hook's specification, by name, in the order of the sources."""
    return {
        name: value
        for place in PLACES
        for name, value in vars(place).items()
        if isinstance(value, FunctionType) and hasattr(value, "apil_spec")
    }


def block(name: str, spec: FunctionType) -> str:
    """What the page says of one hook between the markers."""
    lines = [BEGIN, "", "```python", signature(name, spec), "```", "", "| | |", "|---|---|"]
    lines += [f"| {left} | {right} |" for left, right in facts(spec)]
    return "\n".join([*lines, "", f"Used by: {', '.join(users(name)) or 'the example below'}.", "", END])


def signature(name: str, spec: FunctionType) -> str:
    """As Python, broken where the formatter, which reads this page too, would break it."""
    taken = inspect.signature(spec)
    parameters = [str(p).replace("'", "") for p in taken.parameters.values() if p.name != "self"]
    line = f"def {name}({', '.join(parameters)}) -> {taken.return_annotation}: ..."
    return line if len(line) <= 110 else line.replace("(", "(\n    ", 1).replace(") ->", "\n) ->")


def facts(spec: FunctionType) -> Iterator[tuple[str, str]]:
    """Rows of a hook's table."""
    said = docstring_parser.google.parse(_text(spec))
    life = life_of(spec)
    yield "what for", _plain(said.short_description)
    yield "when", _plain(re.search(r"^When: (.*?)(?:\n\n|\Z)", _text(spec), re.DOTALL | re.MULTILINE)[1])
    for parameter in said.params:
        yield f"`{parameter.arg_name.replace(', ', '`, `')}`", _plain(parameter.description)
    yield "returns", _plain(_answer(said)) if said.returns else "nothing"
    if spec.apil_spec["firstresult"]:
        yield "several answers", "*firstresult*: the first that is not `None` counts"
    elif said.returns and str(inspect.signature(spec).return_annotation).startswith("dict"):
        yield "several answers", "put together; no name may be used twice"
    yield "since", f"hook API {life.since}"
    if life.deprecated:
        end = life.deprecated
        yield "deprecated", f"since hook API {end.since}, gone in {end.removed_in}: {end.instead}"
    for argument, end in life.deprecated_arguments:
        yield (
            f"`{argument}` deprecated",
            f"since hook API {end.since}, gone in {end.removed_in}: {end.instead}",
        )


def _answer(said: docstring_parser.Docstring) -> str:
    """What stands under ``Returns:``; the parser takes what is before a colon, as in a dict, for a type."""
    kind, text = said.returns.type_name, said.returns.description or ""
    return f"{kind}: {text}" if kind else text


def _text(spec: FunctionType) -> str:
    return inspect.getdoc(spec) or ""


def _plain(text: str | None) -> str:
    """One line of Markdown from reStructuredText."""
    line = " ".join((text or "").split()).replace("|", "\\|").rstrip(".")
    line = re.sub(r":(?:class|meth):`([^`]+)`", r"`\1`", line)
    return line.replace("``", "`")


def users(hook: str) -> list[str]:
    """Who fills a hook: the core's modules, built-in plugins, examples; marked where they wrap it."""
    found: dict[str, str] = {}
    for path in _sources():
        for wraps in _fillings(path, hook):
            who = _label(path)
            found.setdefault(who, f"{who} (wraps it)" if wraps else who)
    return list(found.values())


def _sources() -> list[Path]:
    folders = [ROOT / name for name in ("apil_core", "envs", "plugins", "examples")]
    files = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    return [path for path in files if not _NO_USERS & set(path.relative_to(ROOT).parts)]


def _fillings(path: Path, hook: str) -> Iterator[bool]:
    """For each function of that file that fills ``hook``: whether it wraps it."""
    text = path.read_text("utf-8")
    if hook not in text:
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and node.name == hook:
            marks = [ast.unparse(mark) for mark in node.decorator_list if "hookimpl" in ast.dump(mark)]
            if marks:
                yield "wrapper=True" in marks[0]


def _label(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    if parts[0] == "examples":
        return f"[{parts[1]}](../examples/{parts[1]}/README.md)"
    if parts[0] == "plugins":
        return f"`{parts[1]}`"
    if parts[0] == "envs":
        return f"`{parts[1]}`"
    module = parts[:-1] if len(parts) > 2 else (*parts[:-1], path.stem)
    return f"`{'.'.join(module)}`"


def written(page: str) -> str:
    """The page with every hook's block made anew.

    Raises:
        ValueError: a hook has no section, or its section no markers.
    """
    for name, spec in hooks().items():
        pattern = rf"(?<=\n## `{name}`\n\n){re.escape(BEGIN)}.*?{re.escape(END)}"
        made = block(name, spec)
        page, count = re.subn(pattern, lambda _, made=made: made, page, flags=re.DOTALL)
        if count != 1:
            raise ValueError(f"docs/hooks.md: no markers below the heading of {name}")
    return page


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text("utf-8")), "utf-8")

"""The public API is what ``public_api.txt`` lists; this file, run as a script, writes the list anew."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

import apil_core
import apil_core.testing

LIST = Path(__file__).with_name("public_api.txt")
COMMAND = "python tests/api/test_public_api.py"

Function = ast.FunctionDef | ast.AsyncFunctionDef


def listing() -> str:
    """Every public name with its kind, signature, fields and public methods."""
    return "\n\n".join("\n".join(described(name)) for name in apil_core.__all__) + "\n"


def described(name: str) -> Iterator[str]:
    value = getattr(apil_core, name)
    definition = source_of(value)
    if isinstance(definition, ast.ClassDef):
        bases = ", ".join(ast.unparse(base) for base in definition.bases)
        marks = "".join(f"@{ast.unparse(mark)} " for mark in definition.decorator_list)
        yield f"{marks}class {name}({bases})"
        for member in definition.body:
            yield from (f"    {line}" for line in member_lines(member))
    elif definition is not None:
        yield signature(definition)
    else:
        known = isinstance(value, int) and not name.startswith("__")
        yield f"{name}: {type(value).__name__}" + (f" = {value}" if known else "")


def source_of(value: object) -> ast.ClassDef | Function | None:
    """Its definition, or ``None`` for what is neither class nor function."""
    if not (inspect.isclass(value) or inspect.isfunction(value)) or value.__module__ == "builtins":
        return None
    tree = ast.parse(textwrap.dedent(inspect.getsource(value))).body[0]
    assert isinstance(tree, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
    return tree


def member_lines(member: ast.stmt) -> Iterator[str]:
    """A public field or method of a class; nothing for the rest."""
    if isinstance(member, ast.AnnAssign) and not ast.unparse(member.target).startswith("_"):
        yield ast.unparse(member)
    elif isinstance(member, (ast.FunctionDef, ast.AsyncFunctionDef)) and is_public(member):
        marks = [ast.unparse(mark) for mark in member.decorator_list]
        yield "".join(f"@{mark} " for mark in marks) + signature(member)


def is_public(function: Function) -> bool:
    return function.name == "__init__" or not function.name.startswith("_")


def signature(function: Function) -> str:
    returns = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    return f"def {function.name}({ast.unparse(function.args)}){returns}"


def callables() -> Iterator[tuple[str, Function]]:
    """Public functions, and public methods of public classes."""
    for name in apil_core.__all__:
        definition = source_of(getattr(apil_core, name))
        if isinstance(definition, ast.ClassDef):
            for member in definition.body:
                if isinstance(member, (ast.FunctionDef, ast.AsyncFunctionDef)) and is_public(member):
                    yield f"{name}.{member.name}", member
        elif definition is not None:
            yield name, definition


def unannotated(function: Function) -> list[str]:
    taken = function.args
    parameters = [*taken.posonlyargs, *taken.args, *taken.kwonlyargs, taken.vararg, taken.kwarg]
    bare = [p.arg for p in parameters if p and p.annotation is None and p.arg not in ("self", "cls")]
    return bare if function.returns or function.name == "__init__" else [*bare, "what it returns"]


def test_the_public_api_is_the_one_listed() -> None:
    assert listing() == LIST.read_text("utf-8"), f"if that is meant: {COMMAND}, and a line in CHANGELOG.md"


def test_the_listing_tells_signatures_fields_and_methods_apart() -> None:
    lines = listing().splitlines()
    assert "HOOK_API: int = 2" in lines
    assert "class Method(RunPlugin)" in lines
    assert "    def state_dict(self) -> dict[str, Any]" in lines
    assert "    reward: Tensor" in lines
    assert not any(line.strip().startswith("def _") and "__init__" not in line for line in lines)


def test_every_public_name_has_a_place_in_the_sites_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("griffe")
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "docs/site")
    public = {*apil_core.__all__, *apil_core.testing.__all__} - {"__version__"}
    assert public == set(__import__("site_python")._PAGE_OF), "add it to GROUPS in docs/site/site_python.py"


def test_it_is_typed_for_those_who_use_it() -> None:
    assert (Path(apil_core.__file__).parent / "py.typed").is_file()


@pytest.mark.parametrize(("name", "function"), [pytest.param(n, f, id=n) for n, f in callables()])
def test_public_callables_are_annotated(name: str, function: Function) -> None:
    assert unannotated(function) == [], name


def test_a_missing_annotation_would_be_found() -> None:
    (function,) = ast.parse("def f(self, a, *b, c: int = 0): ...").body
    assert isinstance(function, ast.FunctionDef)
    assert unannotated(function) == ["a", "b", "what it returns"]


if __name__ == "__main__":
    LIST.write_text(listing(), "utf-8")

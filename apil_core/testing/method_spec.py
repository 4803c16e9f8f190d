"""Checks of a method that need no run: its spec, its module, its options, its hooks.

Each raises ContractError.
"""

from __future__ import annotations

import inspect
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from typing import Any

from pydantic import BaseModel, ValidationError

from apil_core.api.method import Method
from apil_core.api.specs import Reference, load, options_model
from apil_core.common.errors import PluginError
from apil_core.plugins.check import uninitialised
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.validation import forgotten, unmarked
from apil_core.testing.checks import Subject, checking, hook_in
from apil_core.testing.method_under_test import MethodUnderTest

HEAVY = ("torch", "mujoco")


@checking("spec")
def check_spec(tested: MethodUnderTest) -> None:
    """Check name, summary, factory, hook specifications and requirements."""
    spec = tested.spec
    sound = spec.name and not any(character in spec.name for character in ". \n=/")
    tested.need(sound, f"name {spec.name!r} cannot stand in options.<name>.<key>")
    tested.need("\n" not in spec.summary, "summary must be one line: `apil methods` lists it")
    uninitialised(spec, Method)
    if spec.hookspecs:
        opened = any(hasattr(value, "apil_spec") for value in vars(load(spec.hookspecs)).values())
        text = f"{spec.hookspecs} has no function marked with apil_core.hookspec"
        tested.need(opened, text, hook="hooks of its own")
    names = [required.name for required in tested.registry.method_chain(spec.name)]
    once = len(set(spec.requires)) == len(spec.requires)
    tested.need(once, f"requires names a method twice: {', '.join(spec.requires)}")
    tested.need(names[-1] == spec.name, f"its requirements end in {names[-1]!r}, not in itself")


def check_import(subject: Subject, registry: PluginRegistry, kind: str, name: str) -> None:
    """Import the module that offers ``name`` in a new interpreter and check its imports.

    Args:
        subject: whose present check fails if torch or mujoco is imported; gets a note if none is made.
        registry: of the plugins.
        kind: ``"methods"``, ``"games"`` or ``"policies"``.
        name: of the offered method, game or policy.
    """
    record = next((r for r in registry.records if name in getattr(r, kind) and r.error is None), None)
    if record is None:
        subject.skipped.append("light import: no plugin registers it")
    elif record.origin.startswith("file "):
        subject.skipped.append("light import: a one-file plugin may import what it needs")
    else:
        module = registry.modules[record.name].__name__
        came = " and ".join(_heavy_imports(module))
        text = f"import {module} brings in {came}; import those where they are used"
        subject.need(not came, text, f"register_{kind}")


@cache
def _heavy_imports(module: str) -> tuple[str, ...]:
    """Return which of :data:`HEAVY` an import loads.

    Raises:
        PluginError: it cannot be imported on its own.
    """
    code = (
        f"import sys; sys.path[:] = {sys.path!r}; import {module};"
        f"print(' '.join(name for name in {HEAVY!r} if name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    if done.returncode:
        raise PluginError(f"cannot import {module}: {done.stderr.strip().splitlines()[-1]}")
    return tuple(done.stdout.split())


def check_options(subject: Subject, reference: Reference | None) -> None:
    """Check the options model: unknown keys, docstrings, defaults, JSON."""
    if reference is None:
        return
    model = options_model(reference)
    for name, section in _sections(str(reference), model):
        strict = section.model_config.get("extra") == "forbid"
        subject.need(strict, f"{name} takes unknown keys; derive it from apil_core.Section")
        for key, field in section.model_fields.items():
            documented = bool(field.description) or _is_section(field.annotation)
            subject.need(documented, f"{name}.{key} has no docstring below it")
    model.model_json_schema()
    try:
        made = model()
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        text = f"{reference}() is not valid without arguments: {key}: {first['msg']}"
        raise subject.failed(text) from error
    again = model.model_validate(made.model_dump())  # defaults themselves are not validated by pydantic
    back = model.model_validate_json(again.model_dump_json())
    subject.need(back == made, f"{reference}() is another one after a round trip through JSON")


def _is_section(annotation: Any) -> bool:
    return inspect.isclass(annotation) and issubclass(annotation, BaseModel)


def _sections(name: str, model: type[BaseModel]) -> Iterator[tuple[str, type[BaseModel]]]:
    """The model and all models among its fields, by a name for messages."""
    yield name, model
    for key, field in model.model_fields.items():
        if _is_section(field.annotation):
            yield from _sections(f"{name}.{key}", field.annotation)  # type: ignore[arg-type]


@checking("marks")
def check_marks(tested: MethodUnderTest, method: Method, manager: RunHookManager) -> None:
    """Check for unmarked functions named like a hook, and for hooks that belong to the module."""
    name, hooks = type(method).__name__, manager.manager
    for hook in unmarked(hooks, type(method)):
        text = f"{name}.{hook} is named like a hook but not marked with @hookimpl: it would never be called"
        raise tested.failed(text, hook)
    for hook in vars(hooks.hook):
        of_module = hook.startswith("register_") and callable(getattr(type(method), hook, None))
        text = f"{hook} is a hook of the plugin's module; never called on a method's object"
        tested.need(not of_module, text, hook)


@checking("answers")
def check_answers(tested: MethodUnderTest, manager: RunHookManager) -> None:
    """Check for hooks that should return a value but cannot."""
    for line in forgotten(manager.manager, tested.spec.name):
        raise tested.failed(line, hook_in(line))

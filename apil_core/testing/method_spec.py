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
from apil_core.testing.checks import METHOD_CHECKS, Check, ContractError, hook_in, reported_as
from apil_core.testing.method_under_test import MethodUnderTest

HEAVY = ("torch", "mujoco")


def check_spec(tested: MethodUnderTest) -> None:
    """Check name, summary, factory, hook specifications and requirements."""
    spec = tested.spec
    if not spec.name or any(character in spec.name for character in ". \n=/"):
        raise tested.broken("spec", f"name {spec.name!r} cannot stand in options.<name>.<key>")
    if "\n" in spec.summary:
        raise tested.broken("spec", "summary must be one line: `apil methods` lists it")
    with reported_as(tested.who, METHOD_CHECKS["spec"]):
        uninitialised(spec, Method)
        module = load(spec.hookspecs) if spec.hookspecs else None
        chain = tested.registry.method_chain(spec.name)
    if module is not None and not list(_hookspecs(module)):
        text = f"{spec.hookspecs} has no function marked with apil_core.hookspec"
        raise tested.broken("spec", text, hook="hooks of its own")
    names = [required.name for required in chain]
    if len(set(spec.requires)) != len(spec.requires):
        raise tested.broken("spec", f"requires names a method twice: {', '.join(spec.requires)}")
    if names[-1] != spec.name:
        raise tested.broken("spec", f"its requirements end in {names[-1]!r}, not in itself")


def _hookspecs(module: Any) -> Iterator[str]:
    return (name for name in dir(module) if hasattr(getattr(module, name), "apil_spec"))


def check_import(who: str, check: Check, registry: PluginRegistry, kind: str, name: str) -> str | None:
    """Import the module that offers ``name`` in a new interpreter and check its imports.

    Args:
        who: for the message.
        check: that fails if torch or mujoco is imported.
        registry: of the plugins.
        kind: ``"methods"``, ``"games"`` or ``"policies"``.
        name: of the offered method, game or policy.

    Returns:
        why it was not checked, or ``None``.
    """
    record = next((r for r in registry.records if name in getattr(r, kind) and r.error is None), None)
    if record is None:
        return "light import: no plugin registers it"
    if record.origin.startswith("file "):
        return "light import: a one-file plugin may import what it needs"
    module = registry.modules[record.name].__name__
    with reported_as(who, check):
        came = _heavy_imports(module)
    if came:
        text = f"import {module} brings in {' and '.join(came)}; import those where they are used"
        raise ContractError(who, check, text, f"register_{kind}")
    return None


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


def check_options(who: str, check: Check, reference: Reference | None) -> None:
    """Check the options model: unknown keys, docstrings, defaults, JSON."""
    if reference is None:
        return
    with reported_as(who, check):
        model = options_model(reference)
    for name, section in _sections(str(reference), model):
        if section.model_config.get("extra") != "forbid":
            raise ContractError(who, check, f"{name} takes unknown keys; derive it from apil_core.Section")
        for key, field in section.model_fields.items():
            documented = bool(field.description) or _is_section(field.annotation)
            if not documented:
                raise ContractError(who, check, f"{name}.{key} has no docstring below it")
    with reported_as(who, check):
        model.model_json_schema()
        try:
            made = model()
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(str(part) for part in first["loc"])
            text = f"{reference}() is not valid without arguments: {key}: {first['msg']}"
            raise ContractError(who, check, text) from error
        again = model.model_validate(made.model_dump())  # defaults themselves are not validated by pydantic
        if model.model_validate_json(again.model_dump_json()) != made:
            raise ContractError(who, check, f"{reference}() is another one after a round trip through JSON")


def _is_section(annotation: Any) -> bool:
    return inspect.isclass(annotation) and issubclass(annotation, BaseModel)


def _sections(name: str, model: type[BaseModel]) -> Iterator[tuple[str, type[BaseModel]]]:
    """The model and all models among its fields, by a name for messages."""
    yield name, model
    for key, field in model.model_fields.items():
        if _is_section(field.annotation):
            yield from _sections(f"{name}.{key}", field.annotation)  # type: ignore[arg-type]


def check_marks(tested: MethodUnderTest, method: Method, manager: RunHookManager) -> None:
    """Check for unmarked functions named like a hook, and for hooks that belong to the module."""
    name, hooks = type(method).__name__, manager.manager
    for hook in unmarked(hooks, type(method)):
        text = f"{name}.{hook} is named like a hook but not marked with @hookimpl: it would never be called"
        raise tested.broken("marks", text, hook)
    for hook in vars(hooks.hook):
        if hook.startswith("register_") and callable(getattr(type(method), hook, None)):
            text = f"{hook} is a hook of the plugin's module; never called on a method's object"
            raise tested.broken("marks", text, hook)


def check_answers(tested: MethodUnderTest, manager: RunHookManager) -> None:
    """Check for hooks that should return a value but cannot."""
    for line in forgotten(manager.manager, tested.spec.name):
        raise tested.broken("answers", line, hook_in(line))

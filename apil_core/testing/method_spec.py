"""Checks of a method that need no run: its spec, its module, its options, its hooks' marks."""

from __future__ import annotations

import inspect
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from typing import Any

from pydantic import BaseModel, ValidationError

from apil_core.api.method import Method
from apil_core.api.specs import load, options_model
from apil_core.common.errors import PluginError
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.validation import forgotten
from apil_core.testing.promises import METHOD_PROMISES, ContractError, Promise, hook_in, promised
from apil_core.testing.subject import Subject

HEAVY = ("torch", "mujoco")


def check_spec(subject: Subject) -> None:
    """Name, summary, factory, hook specifications and requirements.

    Raises:
        ContractError: one of them is not what it must be.
    """
    spec = subject.spec
    if not spec.name or any(character in spec.name for character in ". \n=/"):
        raise subject.broken("spec", f"name {spec.name!r} cannot stand in options.<name>.<key>")
    if "\n" in spec.summary:
        raise subject.broken("spec", "summary must be one line: `apil methods` lists it")
    with promised(subject.who, METHOD_PROMISES["spec"]):
        factory = load(spec.factory)
        module = load(spec.hookspecs) if spec.hookspecs else None
        chain = subject.registry.method_chain(spec.name)
    if inspect.isclass(factory) and not issubclass(factory, Method):
        raise subject.broken("spec", f"factory {spec.factory} must be a subclass of apil_core.Method")
    if not callable(factory):
        raise subject.broken("spec", f"factory {spec.factory} must be a class, got {factory!r}")
    if module is not None and not list(_hookspecs(module)):
        text = f"{spec.hookspecs} has no function marked with apil_core.hookspec"
        raise subject.broken("spec", text, hook="hooks of its own")
    names = [required.name for required in chain]
    if len(set(spec.requires)) != len(spec.requires):
        raise subject.broken("spec", f"requires names a method twice: {', '.join(spec.requires)}")
    if names[-1] != spec.name:
        raise subject.broken("spec", f"its requirements end in {names[-1]!r}, not in itself")


def _hookspecs(module: Any) -> Iterator[str]:
    return (name for name in dir(module) if hasattr(getattr(module, name), "apil_spec"))


def check_import(who: str, promise: Promise, registry: PluginRegistry, kind: str, name: str) -> str | None:
    """Import the module that offers ``name`` in a fresh interpreter and look at what came along.

    Args:
        who: for the message.
        promise: that is broken if torch or mujoco came along.
        registry: knows the plugins.
        kind: ``"methods"``, ``"games"`` or ``"policies"``.
        name: of what is offered.

    Returns:
        why it was not checked, or ``None``.

    Raises:
        ContractError: torch or mujoco did.
    """
    record = next((r for r in registry.records if name in getattr(r, kind) and r.error is None), None)
    if record is None:
        return "light import: no plugin registers it"
    if record.origin.startswith("file "):
        return "light import: a one-file plugin may import what it needs"
    module = registry.modules[record.name].__name__
    with promised(who, promise):
        came = _heavy_imports(module)
    if came:
        text = f"import {module} brings in {' and '.join(came)}; import those where they are used"
        raise ContractError(who, promise, text, f"register_{kind}")
    return None


@cache
def _heavy_imports(module: str) -> tuple[str, ...]:
    """Which of :data:`HEAVY` an import brings in.

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


def check_options(who: str, promise: Promise, reference: str | None) -> None:
    """The options model: unknown keys, docstrings, defaults, JSON.

    Raises:
        ContractError: the model is not what it must be.
    """
    if reference is None:
        return
    with promised(who, promise):
        model = options_model(reference)
    for name, section in _sections(reference, model):
        if section.model_config.get("extra") != "forbid":
            raise ContractError(who, promise, f"{name} takes unknown keys; derive it from apil_core.Section")
        for key, field in section.model_fields.items():
            documented = bool(field.description) or _is_section(field.annotation)
            if not documented:
                raise ContractError(who, promise, f"{name}.{key} has no docstring below it")
    with promised(who, promise):
        model.model_json_schema()
        try:
            made = model()
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(str(part) for part in first["loc"])
            text = f"{reference}() is not valid without arguments: {key}: {first['msg']}"
            raise ContractError(who, promise, text) from error
        again = model.model_validate(made.model_dump())  # defaults themselves are not validated by pydantic
        if model.model_validate_json(again.model_dump_json()) != made:
            raise ContractError(who, promise, f"{reference}() is another one after a round trip through JSON")


def _is_section(annotation: Any) -> bool:
    return inspect.isclass(annotation) and issubclass(annotation, BaseModel)


def _sections(name: str, model: type[BaseModel]) -> Iterator[tuple[str, type[BaseModel]]]:
    """The model and all models among its fields, by a name for messages."""
    yield name, model
    for key, field in model.model_fields.items():
        if _is_section(field.annotation):
            yield from _sections(f"{name}.{key}", field.annotation)  # type: ignore[arg-type]


def check_marks(subject: Subject, method: Method, manager: RunHookManager) -> None:
    """Functions named like a hook, but not marked; hooks that belong to the module.

    Raises:
        ContractError: there is one.
    """
    specs = vars(manager.manager.hook)
    for hook in specs:
        function = getattr(type(method), hook, None)
        if not callable(function):
            continue
        if not hasattr(function, "apil_impl"):
            text = f"{type(method).__name__}.{hook} is named like a hook but not marked with @hookimpl"
            raise subject.broken("marks", f"{text}: nobody would call it", hook)
        if hook.startswith("register_"):
            text = f"{hook} is a hook of the plugin's module; nobody asks a method's object"
            raise subject.broken("marks", text, hook)


def check_answers(subject: Subject, manager: RunHookManager) -> None:
    """Hooks that can never answer.

    Raises:
        ContractError: there is one.
    """
    for line in forgotten(manager.manager, subject.spec.name):
        raise subject.broken("answers", line, hook_in(line))

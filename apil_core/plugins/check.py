"""``apil plugins --check``: all checks of plugins that need no run; imports torch."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import pluggy

from apil_core.api.hook_api import HOOK_API, STATEMENT
from apil_core.api.hooks import PROJECT
from apil_core.api.hookspecs import ProcessHooks, RunHooks
from apil_core.api.method import Method, Observer, RunPlugin
from apil_core.api.specs import MethodSpec, RunPluginSpec, load, options_model, titled, wanted_of
from apil_core.common.errors import PluginError
from apil_core.plugins.discovery import PluginRecord, PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.validation import register, remarks


@dataclass(frozen=True)
class PluginReport:
    """Result of checking one plugin.

    Attributes:
        name, version, origin: as :class:`apil_core.plugins.discovery.PluginRecord` has them.
        hook_api: version it states it was built for, or ``None``.
        broken: reasons why it, or something it registers, cannot be used; empty if all works.
        remarks: oddities that are no errors.
    """

    name: str
    version: str
    origin: str
    hook_api: int | None
    broken: tuple[str, ...]
    remarks: tuple[str, ...]


def check_plugins(registry: PluginRegistry) -> list[PluginReport]:
    """One report per plugin, broken ones included, in order of discovery."""
    return [_report(registry, record) for record in registry.records]


def _report(registry: PluginRegistry, record: PluginRecord) -> PluginReport:
    broken, remarks = [], []
    if record.error is not None:
        broken.append(record.error)
    else:
        if record.hook_api is None:
            remarks.append(f"states no hook API version: add {STATEMENT} = {HOOK_API} beside its hooks")
        remarks += _module_remarks(record.name, registry.modules[record.name])
        for name in record.methods:
            _try(partial(_method, registry, name, remarks), broken)
        for name in record.observers:
            _try(partial(_observer, registry, name, remarks), broken)
        for what, reference in _lazily_named(registry, record):
            _try(partial(_loaded, what, reference), broken)
    return PluginReport(
        record.name,
        record.version,
        record.origin,
        record.hook_api,
        tuple(dict.fromkeys(broken)),
        tuple(dict.fromkeys(remarks)),
    )


def _try(examine: Callable[[], object], broken: list[str]) -> None:
    try:
        examine()
    except PluginError as error:
        broken.append(str(error))


def _module_remarks(name: str, module: Any) -> list[str]:
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(ProcessHooks)
    manager.add_hookspecs(RunHooks)
    register(manager, name, module)
    return remarks(manager, name, module)


def _method(registry: PluginRegistry, name: str, remarks: list[str]) -> None:
    """Remarks on a method's run hooks, which are compared with the specifications of all it builds on."""
    spec = registry.methods[name]
    remarks += _run_hooks(spec, Method, registry.method_chain(name))


def _observer(registry: PluginRegistry, name: str, remarks: list[str]) -> None:
    """Remarks on an observer's run hooks."""
    remarks += _run_hooks(registry.observers[name], Observer, ())


def _run_hooks(spec: RunPluginSpec, kind: type[RunPlugin], chain: Sequence[MethodSpec]) -> list[str]:
    who = titled(spec)
    if spec.config is not None:
        options_model(spec.config, who)
    made = uninitialised(spec, kind)
    try:
        notes = None if made is None else RunHookManager(chain, {spec.name: made}).notes()
    except AttributeError:  # e.g. a torch module, whose attributes cannot be read before it is initialised
        notes = None
    if notes is None:
        return [f"{who}: {spec.factory} cannot be made without a run: its run hooks show in one only"]
    return [f"{who}{note.removeprefix(f'plugin {spec.name!r}')}" for note in notes]


def uninitialised(spec: RunPluginSpec, kind: type[RunPlugin]) -> RunPlugin | None:
    """An object of the plugin's class for inspecting its hooks, not calling them; ``None`` without a class.

    Raises:
        PluginError: the factory does not load, or is neither a subclass of ``kind`` nor callable.
    """
    factory = load(spec.factory, titled(spec))
    wanted = wanted_of(spec)
    if not inspect.isclass(factory):
        if callable(factory):
            return None
        raise PluginError(
            f"plugin {spec.name!r}: {spec.factory} must give {wanted}, got {type(factory).__name__}"
        )
    if not issubclass(factory, kind):
        raise PluginError(f"plugin {spec.name!r}: {spec.factory} must be {wanted}, got {factory.__name__}")
    try:
        made: RunPlugin = factory.__new__(factory)
    except TypeError:  # it requires arguments
        return None
    return made


def _lazily_named(registry: PluginRegistry, record: PluginRecord) -> Iterator[tuple[str, str | None]]:
    """References in the other specs: (owner and field, ``"module:attribute"``)."""
    for name in record.games:
        yield f"game {name!r}: factory", registry.games[name].factory
        yield f"game {name!r}: config", registry.games[name].config
    for name in record.policies:
        yield f"policies {name!r}: loader", registry.policies[name].loader
        yield f"policies {name!r}: lister", registry.policies[name].lister
    for name in record.recorders:
        yield f"recorder {name!r}: factory", registry.recorders[name].factory
        yield f"recorder {name!r}: check", registry.recorders[name].check


def _loaded(what: str, reference: str | None) -> None:
    if not reference:
        return
    if what.endswith("config"):
        options_model(reference, what)
    elif not callable(load(reference, what)):
        raise PluginError(f"{what}: {reference} cannot be called")

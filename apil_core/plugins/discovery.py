"""Plugin discovery, isolation of broken plugins, and the hook manager of one run.

A *process-wide* manager finds plugins and collects their specs; a *per-run* manager holds only the
chosen method, its requirements, and the observers switched on.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import pluggy
from pydantic import TypeAdapter, ValidationError

from apil_core.api.hook_api import check_version, stated_version, version_in_source
from apil_core.api.hooks import PROJECT
from apil_core.api.hookspecs import ProcessHooks, RunHooks
from apil_core.api.specs import (
    GameSpec,
    MethodSpec,
    ObserverSpec,
    PolicySpec,
    RecorderSpec,
    RunPluginSpec,
    foreign_code,
)
from apil_core.common.errors import PluginError, UnknownNameError
from apil_core.common.trust import check
from apil_core.plugins.defined import ORIGIN, defined
from apil_core.plugins.validation import register, unmarked

ENTRY_POINT_GROUP = "apil"
_SOURCE = "__apil_source__"
"""Attribute of a one-file plugin's module: the bytes it was imported from."""

_OFFERS = {
    "methods": ("register_methods", MethodSpec, "name"),
    "observers": ("register_observers", ObserverSpec, "name"),
    "games": ("register_games", GameSpec, "name"),
    "policies": ("register_policies", PolicySpec, "scheme"),
    "recorders": ("register_recorders", RecorderSpec, "name"),
}


@dataclass
class PluginRecord:
    """Record of one plugin, working or broken.

    Attributes:
        name: unique among plugins.
        version: of its distribution, or ``""``.
        origin: entry point or file it came from.
        hook_api: hook API version it states it was built for, or ``None``.
        hooks: hooks it implements in the process-wide manager.
        methods, observers, games, policies, recorders: names it registers.
        error: reason why it was left out, or ``None``.
    """

    name: str
    version: str
    origin: str
    hook_api: int | None = None
    hooks: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    observers: tuple[str, ...] = ()
    games: tuple[str, ...] = ()
    policies: tuple[str, ...] = ()
    recorders: tuple[str, ...] = ()
    error: str | None = None


@dataclass
class PluginRegistry:
    """All plugins of this process and the specs of the working ones, by name."""

    records: list[PluginRecord] = field(default_factory=list)
    methods: dict[str, MethodSpec] = field(default_factory=dict)
    observers: dict[str, ObserverSpec] = field(default_factory=dict)
    games: dict[str, GameSpec] = field(default_factory=dict)
    policies: dict[str, PolicySpec] = field(default_factory=dict)
    recorders: dict[str, RecorderSpec] = field(default_factory=dict)
    modules: dict[str, Any] = field(default_factory=dict)
    watchers: dict[str, Any] = field(default_factory=dict)
    """Callbacks of one run that only watch it."""

    def add(self, record: PluginRecord, plugin: Any) -> None:
        """Register the specs of ``plugin``, or record the error."""
        try:
            record.hook_api = stated_version(plugin)
            check_version(record.name, record.hook_api)
            with foreign_code():
                offers = _ask(record, plugin)
            self._check_duplicates(record, offers)
        except Exception as error:
            self._reject(record, error)
            return
        self.records.append(record)
        self.modules[record.name] = plugin
        for kind, specs in offers.items():
            getattr(self, kind).update(specs)
            setattr(record, kind, tuple(specs))

    def add_failure(
        self, record: PluginRecord, error: BaseException, source: str | Path | None = None
    ) -> None:
        """Record a plugin that could not even be imported.

        Args:
            record: of the plugin.
            error: what importing it raised.
            source: its module's name or file: one built for another hook API often fails on a missing name.
        """
        try:
            record.hook_api = None if source is None else version_in_source(source)
            check_version(record.name, record.hook_api)
        except PluginError as reason:
            error = reason
        self._reject(record, error)

    def game(self, name: str) -> GameSpec:
        """The game of that name; a registered full name takes precedence over a family's.

        Raises:
            UnknownNameError: there is none.
        """
        own = self.games.get(name)
        if own is not None and not own.family:
            return own
        scheme, _, target = name.partition(":")
        family = self.games.get(scheme)
        if family is None or not family.family or not target:
            raise UnknownNameError("game", name, self.game_names())
        return replace(family, name=name, family=False, target=target)

    def has_game(self, name: str) -> bool:
        """True if :meth:`game` finds that name."""
        try:
            return bool(self.game(name))
        except UnknownNameError:
            return False

    def game_names(self) -> list[str]:
        """All names, families as ``scheme:…``."""
        return [spec.label for spec in self.games.values()]

    def observer_names(self) -> list[str]:
        """Valid names for ``observers``: registered ones, and plugins that implement run hooks themselves."""
        modules = [r.name for r in self.records if r.error is None and _fills_run_hooks(r)]
        return list(dict.fromkeys([*self.observers, *modules]))

    def run_plugins(self, method: str, observers: Iterable[str]) -> tuple[RunPluginSpec, ...]:
        """Specs of the plugins a run builds: the method's chain, then the registered ones of ``observers``.

        Raises:
            UnknownNameError: no such method.
            PluginError: as :meth:`method_chain`.
        """
        watching = (self.observers[name] for name in observers if name in self.observers)
        return (*self.method_chain(method), *watching)

    def method_chain(self, name: str) -> tuple[MethodSpec, ...]:
        """The method and all it requires, requirements first.

        Raises:
            UnknownNameError: no such method.
            PluginError: a required method is missing or requirements are cyclic.
        """
        if name not in self.methods:
            raise UnknownNameError("method", name, self.methods)
        chain: dict[str, MethodSpec] = {}
        self._visit(name, chain, ())
        return tuple(chain.values())

    def _visit(self, name: str, chain: dict[str, MethodSpec], path: tuple[str, ...]) -> None:
        if name in path:
            raise PluginError(f"methods require each other in a circle: {' → '.join([*path, name])}")
        if name not in self.methods:
            broken = [f"{r.name}: {r.error}" for r in self.records if r.error]
            hint = f"; broken plugins: {'; '.join(broken)}" if broken else ""
            raise PluginError(f"method {path[-1]!r} requires {name!r}, which no working plugin offers{hint}")
        for required in self.methods[name].requires:
            self._visit(required, chain, (*path, name))
        chain[name] = self.methods[name]

    def _check_duplicates(self, record: PluginRecord, offers: dict[str, dict[str, Any]]) -> None:
        watching = {r.name for r in (*self.records, record) if not r.error and _fills_run_hooks(r)}
        for name in sorted(watching & {*self.observers, *offers["observers"]}):
            raise PluginError(f"observer {name!r} has the name of a plugin that fills run hooks itself")
        for name in offers["observers"]:
            if name in self.methods or name in offers["methods"]:
                raise PluginError(
                    f"observer {name!r} has the name of a method: they share the section options"
                )
        for name in offers["methods"]:
            if name in self.observers:
                raise PluginError(
                    f"method {name!r} has the name of an observer: they share the section options"
                )
        for kind, specs in offers.items():
            for name in specs:
                if name in getattr(self, kind):
                    owner = next(r.name for r in self.records if name in getattr(r, kind))
                    raise PluginError(f"{kind[:-1]} {name!r} is already offered by plugin {owner!r}")

    def _reject(self, record: PluginRecord, error: BaseException) -> None:
        reason = " ".join(str(error).split()) or "no message"
        record.error = reason if isinstance(error, PluginError) else f"{type(error).__name__}: {reason}"
        self.records.append(record)
        if os.environ.get("APIL_STRICT_PLUGINS") == "1":
            raise PluginError(
                f"plugin {record.name!r} ({record.origin}) is broken: {record.error}"
            ) from error


def _fills_run_hooks(record: PluginRecord) -> bool:
    """True if the plugin's module can be switched on as an observer."""
    return bool(set(record.hooks) & vars(RunHooks).keys())


def _ask(record: PluginRecord, plugin: Any) -> dict[str, dict[str, Any]]:
    # One manager per plugin: an error of pluggy is then that plugin's fault.
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(ProcessHooks)
    manager.add_hookspecs(RunHooks)  # an observer's run hooks are in the same module
    register(manager, record.name, plugin)
    for hook in unmarked(manager, plugin):
        if hook in vars(ProcessHooks):
            raise PluginError(f"{hook} is not marked with @hookimpl, so it is never called")
    callers = manager.get_hookcallers(plugin) or []
    record.hooks = tuple(sorted(caller.name for caller in callers))
    offers: dict[str, dict[str, Any]] = {}
    for kind, (hook, spec_type, key) in _OFFERS.items():
        offers[kind] = {}
        answers = getattr(manager.hook, hook)()
        if not answers and getattr(manager.hook, hook).get_hookimpls():
            answers = [None]  # pluggy drops None from the results
        for answer in answers:
            if not isinstance(answer, Iterable):
                wanted = f"{hook} must return a list of {spec_type.__name__}"
                raise PluginError(f"{wanted}, got {type(answer).__name__}")
            for spec in answer:
                if not isinstance(spec, spec_type):
                    raise PluginError(f"{hook} must return {spec_type.__name__} objects, got {spec!r}")
                _check_fields(spec, getattr(spec, key))
                if getattr(spec, key) in offers[kind]:
                    raise PluginError(f"{hook} returns {getattr(spec, key)!r} twice")
                offers[kind][getattr(spec, key)] = spec
    return offers


_adapter: Any = cache(TypeAdapter)  # of a few classes, asked for once a spec


def _check_fields(spec: Any, name: object) -> None:
    """Check that every field has a value of its type, so that listings cannot fail on one."""
    try:
        _adapter(type(spec)).validate_python(asdict(spec))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise PluginError(f"{type(spec).__name__} {name!r}: {where}: {first['msg']}") from error


def discover(files: Sequence[str | Path] = (), *, forgiving: bool = False) -> PluginRegistry:
    """Find all plugins: entry points of group ``apil``, those of this process, then one-file plugins.

    A plugin that fails is recorded with its error and left out; ``APIL_STRICT_PLUGINS=1`` raises.

    Args:
        files: paths of one-file plugins (``--plugin FILE.py``); a missing file raises ``PluginError``,
            since the user named that file.
        forgiving: record missing files like any other broken plugin instead.
    """
    registry = PluginRegistry()
    told = cache(attrgetter("metadata"))  # each access parses a file
    about = {
        e: told(e.dist) if e.dist else {} for e in importlib.metadata.entry_points(group=ENTRY_POINT_GROUP)
    }
    for entry_point in sorted(about, key=lambda e: (about[e].get("Name") != PROJECT, e.name)):
        version = about[entry_point].get("Version", "")
        record = PluginRecord(entry_point.name, version, f"entry point {entry_point.value}")
        if any(r.name == record.name for r in registry.records):
            registry.add_failure(record, PluginError(f"a plugin named {record.name!r} exists already"))
            continue
        try:
            with foreign_code():
                plugin = entry_point.load()
        except Exception as error:
            registry.add_failure(record, error, entry_point.module)
        else:
            registry.add(record, plugin)
    for name, plugin in defined.items():
        record = PluginRecord(name, "", ORIGIN)
        if any(r.name == name for r in registry.records):
            registry.add_failure(record, PluginError(f"a plugin named {name!r} exists already"))
        else:
            registry.add(record, plugin)
    # a run names its files, and a flag may name the same one again
    for file in {Path(file).resolve(): Path(file) for file in files}.values():
        check(str(file.resolve()))
        record = _add_file(registry, file)
        if record.error is not None and not forgiving:
            raise PluginError(f"--plugin {file}: {record.error}")
    return registry


def _add_file(registry: PluginRegistry, path: Path) -> PluginRecord:
    record = PluginRecord(path.stem, "", f"file {path.resolve()}")
    try:
        with foreign_code():
            plugin = import_file(path)
    except Exception as error:
        registry.add_failure(record, error, path)
    else:
        registry.add(record, plugin)
    return record


def import_file(path: Path) -> Any:
    """Import a one-file plugin under its stem, so that its specs can name ``"<stem>:Class"``.

    A file that was edited since is imported anew; objects made before keep the code they were made with.
    """
    if not path.is_file():
        raise PluginError("no such file")
    name, source = path.stem, path.read_bytes()
    loaded = sys.modules.get(name)
    if loaded is not None:
        if Path(getattr(loaded, "__file__", "") or "").resolve() != path.resolve():
            raise PluginError(f"its name {name!r} is taken by an imported module; rename the file")
        if getattr(loaded, _SOURCE, source) == source:
            return loaded
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.origin is None:
        raise PluginError("not a Python file (its name must end in .py)")
    module = importlib.util.module_from_spec(spec)
    setattr(module, _SOURCE, source)
    sys.modules[name] = module
    try:
        # not the loader's exec_module: its bytecode cache misses an edit within a second
        exec(compile(source, spec.origin, "exec"), module.__dict__)
    except BaseException:
        if loaded is None:
            del sys.modules[name]
        else:
            sys.modules[name] = loaded
        raise
    return module

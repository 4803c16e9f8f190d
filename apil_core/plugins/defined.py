"""Methods, observers and policies made in this Python process, such as a notebook's classes."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, TypeAlias

from apil_core.api.hook_api import HOOK_API
from apil_core.api.hooks import hookimpl
from apil_core.api.specs import MethodSpec, ObserverSpec, RunPluginSpec
from apil_core.common.errors import ConfigError, PluginError, VictimError

if TYPE_CHECKING:  # both import torch
    from apil_core.api.method import RunPlugin
    from apil_core.api.policy import Policy

SCHEME = "object"
ORIGIN = "this Python process"

PolicyLike: TypeAlias = "Policy | PathLike[str] | str"
"""A policy, its name, or the directory of a run."""


@dataclass(frozen=True)
class DefinedPlugin:
    """A plugin that registers one method or observer, as an installed package would."""

    spec: RunPluginSpec
    APIL_HOOK_API: int = HOOK_API

    @hookimpl
    def register_methods(self) -> list[MethodSpec]:
        """The method, if it is one."""
        return [self.spec] if isinstance(self.spec, MethodSpec) else []

    @hookimpl
    def register_observers(self) -> list[ObserverSpec]:
        """The observer, if it is one."""
        return [self.spec] if isinstance(self.spec, ObserverSpec) else []


defined: dict[str, Any] = {}
"""Plugin objects by name; every discovery of plugins adds them to the installed ones."""

_policies: dict[str, Policy] = {}


def define(*parts: type[RunPlugin] | RunPluginSpec) -> tuple[str, ...]:
    """Make methods and observers of this process known by name, as an installed plugin would.

    Defining a name again (a notebook's cell runs twice) replaces it. A run stores the name only: where the
    class is absent, resuming and evaluating refuse, until it is defined there.

    Args:
        parts: classes, named in snake case; or specs whose factory (and ``config``) is the class itself,
            for one with options or requirements: ``MethodSpec("slow", Slow, requires=("apl",))``.

    Returns:
        their names.

    Raises:
        PluginError: an installed plugin has that name.
    """
    specs = [part if isinstance(part, (MethodSpec, ObserverSpec)) else spec_of(part) for part in parts]
    add({spec.name: DefinedPlugin(spec) for spec in specs})
    return tuple(spec.name for spec in specs)


def add(plugins: Mapping[str, Any]) -> None:
    """Make plugin objects known to this process, by name.

    Raises:
        PluginError: one of them cannot be used; none is known then.
    """
    from apil_core.plugins.registry import default_plugins

    before = dict(defined)
    defined.update(plugins)
    for record in default_plugins().records:
        if record.error and record.origin == ORIGIN:
            defined.clear()
            defined.update(before)
            raise PluginError(f"{record.name} cannot be used: {record.error}")


def spec_of(part: type[RunPlugin]) -> RunPluginSpec:
    """The spec of a class: its name in snake case, and its docstring's first line.

    Raises:
        ConfigError: it is no class of a method or an observer.
    """
    from apil_core.api.method import Method, RunPlugin

    if not (isinstance(part, type) and issubclass(part, RunPlugin)):
        raise ConfigError(f"{part!r} is neither a class of apil_core.Method or Observer, nor a spec of one")
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", part.__name__).lower()
    summary = (part.__doc__ or "").strip().partition("\n")[0]
    kind = MethodSpec if issubclass(part, Method) else ObserverSpec
    return kind(name, part, summary)


def policy_name(policy: PolicyLike) -> str:
    """The name of a policy: its own, a path's text, or for an object one that loads it in this process."""
    if isinstance(policy, (str, PathLike)):
        return fspath(policy)
    for name, known in _policies.items():
        if known is policy:
            return f"{SCHEME}:{name}"
    name = f"{type(policy).__name__}-{len(_policies) + 1}"
    _policies[name] = policy
    return f"{SCHEME}:{name}"


def named(policies: Mapping[str, PolicyLike]) -> dict[str, str]:
    """:func:`policy_name` of each."""
    return {label: policy_name(policy) for label, policy in policies.items()}


def load(name: str) -> Policy:
    """A copy of the policy object of that name: players share no recurrent state.

    Raises:
        VictimError: this process has made none.
    """
    if name not in _policies:
        raise VictimError(f"{SCHEME}:{name} was an object of the Python session that named it: it is gone")
    policy = copy.deepcopy(_policies[name])
    policy.info = replace(policy.info, name=f"{SCHEME}:{name}")
    return policy


def as_text(value: Any) -> Any:
    """Policies and paths as names; anything else unchanged, to be checked."""
    return policy_name(value) if hasattr(value, "act") or isinstance(value, PathLike) else value

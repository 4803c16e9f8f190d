"""Checks that a plugin implements existing hooks with existing arguments; warnings about oddities in it.

pluggy rejects such plugins by itself; the messages here add what would be right.
"""

from __future__ import annotations

import ast
import difflib
import inspect
import textwrap
from collections.abc import Iterator
from typing import Any

import pluggy

from apil_core.api.hooks import PROJECT, life_of
from apil_core.common.errors import PluginError

_MAY_STAY_SILENT = frozenset({"update_auxiliary"})
"""Hooks whose return value is optional (metrics)."""


def register(manager: pluggy.PluginManager, name: str, plugin: Any) -> None:
    """Register ``plugin`` with all its hook implementations.

    Raises:
        PluginError: it implements an unknown hook, takes an argument a hook lacks, or pluggy rejects it.
    """
    for attribute, hook, wraps in _marked(manager, plugin):
        spec = _spec(manager, hook)
        if spec is None:
            raise PluginError(f"unknown hook {hook!r} ({_hint(manager, hook)})")
        wrong = [a for a in _required(getattr(plugin, attribute)) if a not in spec.argnames]
        if wrong:
            offered = ", ".join(spec.argnames) or "none"
            taken = f"{hook} takes {wrong[0]!r}, an argument that hook does not have"
            raise PluginError(f"{taken} (it has: {offered})")
        if wraps and not inspect.isgeneratorfunction(getattr(plugin, attribute)):
            raise PluginError(f"{hook} is marked as a wrapper, but has no yield")
    try:
        manager.register(plugin, name=name)
        manager.check_pending()
    except (pluggy.PluginValidationError, ValueError) as error:
        raise PluginError(" ".join(str(error).split())) from error


def deprecated(manager: pluggy.PluginManager, name: str) -> list[str]:
    """Deprecated hooks and arguments that the plugin of that name uses, one line each."""
    lines = []
    for hook, implementation, spec in _filled(manager, name):
        life = life_of(spec)
        if life.deprecated:
            lines.append(str(life.deprecated.warning(f"hook {hook!r}")))
        for argument, end in life.deprecated_arguments:
            if argument in (*implementation.argnames, *implementation.kwargnames):
                lines.append(str(end.warning(f"argument {argument!r} of hook {hook!r}")))
    return lines


def forgotten(manager: pluggy.PluginManager, name: str) -> list[str]:
    """Hooks of the plugin of that name that need a return value but get none, one line each."""
    lines = []
    for hook, implementation, spec in _filled(manager, name):
        if not _wants_answer(spec) or _answers(implementation):
            continue
        if implementation.wrapper:
            lines.append(f"{hook} is a wrapper without `return`: what the others answered is lost")
        elif hook not in _MAY_STAY_SILENT:
            silent = f"{hook} has no return with a value, so it changes nothing"
            lines.append(f"{silent}; if that is meant, annotate it '-> None'")
    return lines


def unmarked(manager: pluggy.PluginManager, plugin: Any) -> list[str]:
    """Hooks for which ``plugin`` has a function of that name that is not marked as an implementation."""
    return [
        hook
        for hook in sorted(vars(manager.hook))
        if inspect.isfunction(found := inspect.getattr_static(plugin, hook, None))
        and not hasattr(found, f"{PROJECT}_impl")
        and not hasattr(found, f"{PROJECT}_spec")
    ]


def remarks(manager: pluggy.PluginManager, name: str, plugin: Any) -> list[str]:
    """Warnings about a registered plugin, one line each."""
    never = "is named like a hook but not marked with @hookimpl, so it is never called"
    return [
        *deprecated(manager, name),
        *(f"{hook} {never}" for hook in unmarked(manager, plugin)),
        *forgotten(manager, name),
    ]


def _marked(manager: pluggy.PluginManager, plugin: Any) -> Iterator[tuple[str, str, bool]]:
    """(attribute, hook, whether it wraps) of everything marked with ``hookimpl``."""
    for attribute in dir(plugin):
        options = manager.parse_hookimpl_opts(plugin, attribute)
        if options is not None and not options.get("optionalhook"):
            wraps = bool(options.get("wrapper") or options.get("hookwrapper"))
            yield attribute, options.get("specname") or attribute, wraps


def _spec(manager: pluggy.PluginManager, hook: str) -> Any:
    return getattr(getattr(manager.hook, hook, None), "spec", None)


def _hint(manager: pluggy.PluginManager, hook: str) -> str:
    known = [name for name in vars(manager.hook) if _spec(manager, name) is not None]
    close = difflib.get_close_matches(hook, known, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    return "docs/hooks.md lists them; one that a method opens needs that method among those it requires"


def _required(function: Any) -> list[str]:
    """Names of the arguments without a default."""
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    parameters = inspect.signature(function).parameters.values()
    return [p.name for p in parameters if p.kind in kinds and p.default is inspect.Parameter.empty]


def _filled(manager: pluggy.PluginManager, name: str) -> Iterator[tuple[str, pluggy.HookImpl, Any]]:
    """(hook, implementation, marked function of the specification)."""
    for hook in sorted(vars(manager.hook)):
        spec = _spec(manager, hook)
        for implementation in getattr(manager.hook, hook).get_hookimpls():
            if spec is not None and implementation.plugin_name == name:
                yield hook, implementation, spec.function


def _wants_answer(spec: Any) -> bool:
    return inspect.get_annotations(spec).get("return", "None") not in (None, "None")


def _answers(implementation: pluggy.HookImpl) -> bool:
    """True if it returns a value (or yields one, and is no wrapper), or is annotated to return none.

    True also where this is unknown.
    """
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(implementation.function))).body[0]
    except (OSError, TypeError, SyntaxError, IndexError):
        return True
    if not isinstance(tree, (ast.FunctionDef, ast.AsyncFunctionDef)):
        return True  # a lambda always returns a value
    says_so = isinstance(tree.returns, ast.Constant) and tree.returns.value is None
    answering = (
        (isinstance(node, (ast.Yield, ast.YieldFrom)) and not implementation.wrapper)
        or (isinstance(node, ast.Return) and node.value is not None)
        for node in _own_nodes(tree)
    )
    return says_so or isinstance(tree.body[-1], ast.Raise) or any(answering)


def _own_nodes(function: ast.AST) -> Iterator[ast.AST]:
    """Nodes below, without those of functions and classes defined inside."""
    for node in ast.iter_child_nodes(function):
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)):
            yield node
            yield from _own_nodes(node)

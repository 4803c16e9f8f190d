"""The two markers plugins use, and the name they share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar, overload

import pluggy

from apil_core.api.hook_api import Deprecation, HookLife

PROJECT = "apil"

_Function = TypeVar("_Function", bound=Callable[..., Any])
_mark = pluggy.HookspecMarker(PROJECT)

hookimpl = pluggy.HookimplMarker(PROJECT)
"""Marks a function or method as a hook implementation."""


@overload
def hookspec(function: _Function) -> _Function: ...


@overload
def hookspec(
    function: None = None,
    *,
    firstresult: bool = False,
    since: int = 1,
    deprecated: Deprecation | None = None,
    deprecated_arguments: Mapping[str, Deprecation] | None = None,
) -> Callable[[_Function], _Function]: ...


def hookspec(
    function: Any = None,
    *,
    firstresult: bool = False,
    since: int = 1,
    deprecated: Deprecation | None = None,
    deprecated_arguments: Mapping[str, Deprecation] | None = None,
) -> Any:
    """Mark a function as a hook that other plugins may implement (for plugins that define their own hooks).

    Args:
        function: where the marker is used without arguments.
        firstresult: only the first answer that is not ``None`` counts.
        since: hook API version it came with.
        deprecated: its announced removal; plugins that implement it get a warning.
        deprecated_arguments: removals of arguments, by name; plugins that take them get a warning.
    """

    def marked(function: _Function) -> _Function:
        ends = dict(deprecated_arguments or {})
        name = function.__name__
        spec = _mark(
            function,
            firstresult=firstresult,
            warn_on_impl=deprecated.warning(f"hook {name!r}") if deprecated else None,
            warn_on_impl_args={
                argument: end.warning(f"argument {argument!r} of hook {name!r}")
                for argument, end in ends.items()
            },
        )
        spec.apil_life = HookLife(since, deprecated, tuple(ends.items()))  # type: ignore[attr-defined]
        return spec

    return marked if function is None else marked(function)


def life_of(spec: Any) -> HookLife:
    """Lifetime of a function marked with :func:`hookspec`."""
    return getattr(spec, "apil_life", HookLife(1))

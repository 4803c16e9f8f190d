"""The installed plugins and one that a test makes."""

from __future__ import annotations

import sys
import types
from typing import Any

from apil_core import Method, MethodSpec, hookimpl
from apil_core.plugins.discovery import PluginRecord, PluginRegistry, discover


def registry_with(
    made: type[Method],
    name: str = "curious",
    requires: tuple[str, ...] = ("apl",),
    white_box: bool = False,
    **hooks: Any,
) -> PluginRegistry:
    """Register a method, and functions for hooks of its module, as an installed plugin is."""
    module: Any = types.ModuleType(f"plugin_{name}")
    module.Made = made
    sys.modules[module.__name__] = module
    spec = MethodSpec(name, f"{module.__name__}:Made", requires=requires, white_box=white_box)
    module.register_methods = hookimpl(lambda: [spec])
    for hook, function in hooks.items():
        setattr(module, hook, hookimpl(function))
    registry = discover()
    record = PluginRecord(name, "", "test")
    registry.add(record, module)
    assert record.error is None, record.error
    return registry

"""The configurations that come with the package."""

from __future__ import annotations

from collections.abc import Iterator

from apil_core.common.errors import ApilError
from apil_core.config.layers import preset_layer, preset_names
from apil_core.config.resolve import resolve_layers
from apil_core.doctor.finding import Finding, good, listed, warning
from apil_core.doctor.scope import Scope


def check(scope: Scope) -> Iterator[Finding]:
    """Whether every preset is valid with the plugins that work."""
    valid = []
    for name in preset_names():
        try:
            resolve_layers([preset_layer(name)], scope.plugins)
        except ApilError as reason:
            text = " ".join(str(reason).split())
            yield warning(f"preset: {name}", text, "use another preset, or reinstall")
        else:
            valid.append(name)
    if valid:
        yield good("presets", f"valid: {listed(valid)}")

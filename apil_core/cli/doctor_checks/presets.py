"""The configurations that come with the package."""

from __future__ import annotations

from collections.abc import Iterator

from apil_core.cli.doctor_checks.finding import Finding, good, listed, warning
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.common.errors import ApilError
from apil_core.config.layers import preset_layer, preset_names
from apil_core.config.resolve import resolve_layers


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

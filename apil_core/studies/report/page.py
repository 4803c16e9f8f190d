"""The report as one HTML file that needs nothing else: no network, no other file, no server."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.common.files import write_atomically
from apil_core.studies.report import page_summary
from apil_core.studies.report.figures import palette
from apil_core.studies.report.models import Evidence
from apil_core.studies.report.page_sections import sections
from apil_core.studies.report.page_views import Section, table_views
from apil_core.studies.report.words import amount, percent

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


def write_page(evidence: Evidence, path: Path) -> None:
    """Write the report's page, atomically; a file of that name is replaced.

    plotly.js is in it once and makes most of its five megabytes.

    Raises:
        RunDirError: the file cannot be written.
    """
    text = render(evidence)
    write_atomically(path, lambda file: file.write(text.encode()))


def render(evidence: Evidence) -> str:
    """The page's HTML. Names and messages of plugins are text in it, never markup."""
    from plotly.offline import get_plotlyjs, get_plotlyjs_version

    environment = _environment()
    pens = palette.pens([*evidence.columns, *_opponents(evidence)])
    shown = sections(evidence, pens)
    plotly, script = _raw(get_plotlyjs()), _raw(_source(environment, "page.js"))
    return environment.get_template("page.html.j2").render(
        evidence=evidence,
        sections=shown,
        tables=table_views(evidence),
        settings={setting.id: setting.label for setting in evidence.settings},
        pens=pens,
        colours=palette.variables(),
        bests=page_summary.bests(evidence),
        verdicts=page_summary.verdicts(evidence),
        facts=page_summary.facts(evidence),
        loud=page_summary.loud(evidence),
        absent=[section.title for section in shown if section.missing and section.key != "warnings"],
        common_notes=page_summary.common_notes(evidence),
        policy=_raw(_policy((plotly, script))),
        style=_raw(_source(environment, "page.css")),
        specs=_specs(shown),
        plotly=plotly,
        plotly_version=get_plotlyjs_version(),
        script=script,
    )


def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("apil_core.studies.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(percent=percent, whole=_whole, signed=_signed, amount=amount, yaml=_yaml)
    return environment


def _source(environment: Environment, name: str) -> str:
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]


def _raw(text: str) -> Markup:
    """Not to be escaped: our own style and scripts."""
    from markupsafe import Markup

    # line ends as HTML reads them, since the policy's hashes are of what a browser reads
    return Markup(text.replace("\r\n", "\n"))


def _policy(scripts: Sequence[str]) -> str:
    """Only these two scripts may run, and nothing may be fetched."""
    hashes = " ".join(f"'sha256-{_digest(script)}'" for script in scripts)
    rules = {
        "default-src": "'none'",
        "script-src": hashes,
        "style-src": "'unsafe-inline'",  # plotly styles its elements one by one
        "img-src": "data: blob:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _digest(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _specs(shown: Sequence[Section]) -> Markup:
    """Figures by the id of their place, as JSON in which nothing can end the script element."""
    specs = {
        f"figure-{section.key}-{i}": plot.figure
        for section in shown
        for i, plot in enumerate(section.plots, 1)
    }
    text = json.dumps(specs, separators=(",", ":"), allow_nan=False)
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return _raw(text)


def _opponents(evidence: Evidence) -> list[str]:
    """Who else has columns, lines or points of its own."""
    columns = [column for table in evidence.tables for column in table.columns]
    retrained = [line.opponent for curve in evidence.retraining for line in curve.lines]
    return [*columns, *retrained, *(cloud.opponent for a in evidence.activations for cloud in a.clouds)]


def _whole(share: float) -> str:
    return f"{100 * share:.0f}"


def _signed(share: float) -> str:
    return f"{100 * share:+.1f}".replace("-", "−")


def _yaml(data: Mapping[str, Any]) -> str:
    from io import StringIO

    from ruamel.yaml import YAML

    stream = StringIO()
    YAML(typ="safe", pure=True).dump(dict(data), stream)
    return stream.getvalue()

"""The report as one self-contained HTML file: no network, no other file, no server."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.common.charts import Pen
from apil_core.common.files import write_atomically
from apil_core.common.visible import visible
from apil_core.studies.report import page_summary
from apil_core.studies.report.figures import palette
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.page_sections import sections
from apil_core.studies.report.words import amount, percent

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

_MARKS = dict(zip("osD^vP*", "●■◆▲▼✚★", strict=True))
_DASHES = {"-": "solid", "--": "dashed", ":": "dotted", "-.": "dashed"}


def write_page(data: ReportData, path: Path) -> None:
    """Write the report's page, atomically; a file of that name is replaced.

    Raises:
        RunDirError: the file cannot be written.
    """
    text = render(data)
    write_atomically(path, lambda file: file.write(text.encode()))


def render(data: ReportData) -> str:
    """Render the page's HTML. Names and messages of plugins are text in it, never markup."""
    environment = _environment()
    pens = palette.pens([*data.columns, *_opponents(data)])
    script = _raw(_source(environment, "page.js"))
    text = environment.get_template("page.html.j2").render(
        data=data,
        sections=sections(data, pens),
        settings={setting.id: setting.label for setting in data.settings},
        pens=pens,
        colours=palette.variables(),
        bests=page_summary.bests(data),
        verdicts=page_summary.verdicts(data),
        facts=page_summary.facts(data),
        paper=any(cell.win.published is not None for t in data.tables for row in t.rows for cell in row),
        common_notes=page_summary.common_notes(data),
        policy=_raw(_policy(script)),
        style=_raw(_source(environment, "page.css")),
        script=script,
    )
    return visible(text)


def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("apil_core.studies.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        percent=percent,
        whole=lambda share: f"{100 * share:.0f}",
        signed=lambda share: f"{100 * share:+.1f}".replace("-", "−"),
        amount=amount,
        yaml=_yaml,
        mark=_mark,
    )
    return environment


def _source(environment: Environment, name: str) -> str:
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]


def _raw(text: str) -> Markup:
    """Mark our own style or script as safe, so that it is not escaped."""
    from markupsafe import Markup

    # line ends as HTML reads them, since the policy's hash is of what a browser reads
    return Markup(text.replace("\r\n", "\n"))


def _policy(script: str) -> str:
    """Content security policy: only this script may run, and nothing may be fetched."""
    rules = {
        "default-src": "'none'",
        "script-src": f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'",
        "style-src": "'unsafe-inline'",  # SVG has its colours in style attributes
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _opponents(data: ReportData) -> list[str]:
    """Names of all columns, lines and points that need a colour of their own."""
    columns = [column for table in data.tables for column in table.columns]
    retrained = [group.label for curve in data.retraining for group in curve.groups]
    return [*columns, *retrained, *(name for each in data.activations for name in each.opponents)]


def _mark(pen: Pen) -> Markup:
    """Legend symbol of a pen: its dash and its marker, in its colour."""
    from markupsafe import Markup

    colour, dash, mark = palette.with_variables(pen.colour), _DASHES[pen.dashes], _MARKS[pen.marker]
    return Markup(f'<span class="mark {dash}" style="color:{colour}" aria-hidden="true">{mark}</span>')


def _yaml(data: Mapping[str, Any]) -> str:
    from io import StringIO

    from ruamel.yaml import YAML

    stream = StringIO()
    YAML(typ="safe", pure=True).dump(dict(data), stream)
    return stream.getvalue()

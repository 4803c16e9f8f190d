"""The four tables as LaTeX, without packages."""

from __future__ import annotations

from apil_core.common.visible import visible
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.table_models import Figure, Table
from apil_core.studies.report.words import percent

_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "−": "$-$",
    "≥": r"$\geq$",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    **{sign: f"{{{sign}}}" for sign in "[]"},
    **{"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", "\n": " "},
}
_SIGNS = {"within noise": r"$\approx$", "higher": r"$\uparrow$", "lower": r"$\downarrow$"}


def escaped(text: str) -> str:
    """Escape text for LaTeX; ``[`` too: at the start of a row it would belong to the end of the last one."""
    return "".join(_SPECIAL.get(letter, letter) for letter in visible(text))


def latex_table(data: ReportData, table: Table) -> str:
    """Make a ``table`` environment; the caption has the setting and how it differs from the published one."""
    setting = data.setting(table.setting)
    blind = f", blinded: {table.blind}" if table.blind else ""
    caption = f"{table.title} ({setting.label}{blind}). {' '.join(setting.notes)}"
    notes = {f"{c.column}: {c.replayed}." for row in table.rows for c in row if c.replayed and c.scores}
    caption = " ".join([caption, *sorted(notes)])
    lines = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{escaped(caption)} Per cent of games the {escaped(table.side)} wins, with 95\,\% "
        r"intervals; in parentheses the published value.}",
        rf"\begin{{tabular}}{{ll{'r' * len(table.columns)}}}",
        r"\hline",
        " & ".join(["game", "share", *map(escaped, table.columns)]) + r" \\",
        r"\hline",
    ]
    for cells in table.rows:
        lines.append(" & ".join([escaped(cells[0].game), "win", *(_figure(c.win) for c in cells)]) + r" \\")
        lines.append(" & ".join(["", "win+tie", *(_figure(c.win_or_tie) for c in cells)]) + r" \\")
    return "\n".join([*lines, r"\hline", r"\end{tabular}", r"\end{table}", ""])


def _figure(figure: Figure) -> str:
    published = "" if figure.published is None else f" ({100 * figure.published:.0f})"
    if figure.measured is None:
        return f"--{published}"
    own = figure.measured
    sign = _SIGNS.get(figure.verdict, "")
    return rf"{percent(own.value)} {{\scriptsize [{percent(own.low)}, {percent(own.high)}]}}{published}{sign}"

"""Tables as LaTeX, without packages."""

from __future__ import annotations

from collections.abc import Sequence

from apil_core.common.visible import visible
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.paper_claims import WORDS
from apil_core.studies.report.table_models import Figure, Setting, Table
from apil_core.studies.report.words import percent, several

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
    notes = {f"{c.column}: {c.replayed}." for c in table.cells if c.replayed}
    caption = [f"{table.title} ({setting.label}{blind}).", *setting.notes, *sorted(notes)]
    caption.append(
        f"Per cent of games the {table.side} wins, with 95 % intervals; in parentheses the published"
    )
    rows = []
    for cells in table.rows:
        rows.append([cells[0].game, "win", *(_figure(c.win) for c in cells)])
        rows.append(["", "win+tie", *(_figure(c.win_or_tie) for c in cells)])
    return _latex(f"{' '.join(caption)} value.", ["game", "share", *table.columns], rows, left=2)


def latex_aggregates(data: ReportData, setting: Setting) -> str:
    """Interquartile means of a setting, with the performance profile at three scores, and improvements."""
    games = several(len(next(each.games for each in data.aggregates if each.setting == setting.id)), "game")
    profiles = {(e.column, e.metric): e for e in data.profiles if e.setting == setting.id}
    scores = (25, 50, 75) if profiles else ()
    rows = []
    for each in (each for each in data.aggregates if each.setting == setting.id):
        profile = profiles.get((each.column, each.metric))
        above = [
            _interval(profile.value[i], profile.low[i], profile.high[i]) if profile else "--" for i in scores
        ]
        mean = _interval(each.iqm, each.low, each.high)
        rows.append([each.column, WORDS[each.metric], mean, *above, str(each.seeds)])
    caption = f"Over {games} ({setting.label}): interquartile mean, %"
    caption += ", and share of runs with a score above 25, 50 and 75 %" * bool(scores)
    header = ["method", "share", "IQM", *(f"> {i} %" for i in scores), "seeds"]
    tables = [_latex(f"{caption}; 95 % stratified bootstrap intervals.", header, rows, left=2)]
    improved = [
        [each.column, each.base, WORDS[each.metric], _interval(each.value, each.low, each.high)]
        for each in data.improvements
        if each.setting == setting.id
    ]
    if improved:
        caption = f"Probability that a run of a method scores higher than one of another, % ({setting.label})"
        caption += f"; mean over {games}, 95 % stratified bootstrap intervals."
        tables.append(_latex(caption, ["method", "over", "share", "probability"], improved, left=3))
    return "\n".join(tables)


def _latex(caption: str, header: Sequence[str], rows: Sequence[Sequence[str]], left: int) -> str:
    """A ``table`` environment; the first ``left`` columns are text, the others LaTeX, flush right."""
    head = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{escaped(caption)}}}",
        rf"\begin{{tabular}}{{{'l' * left}{'r' * (len(header) - left)}}}",
        r"\hline",
        " & ".join(map(escaped, header)) + r" \\",
        r"\hline",
    ]
    body = [" & ".join([*map(escaped, row[:left]), *row[left:]]) + r" \\" for row in rows]
    return "\n".join([*head, *body, r"\hline", r"\end{tabular}", r"\end{table}", ""])


def _figure(figure: Figure) -> str:
    published = "" if figure.published is None else f" ({100 * figure.published:.0f})"
    own = figure.measured
    if own is None:
        return f"--{published}"
    return f"{_interval(own.value, own.low, own.high)}{published}{_SIGNS.get(figure.verdict, '')}"


def _interval(value: float, low: float | None, high: float | None) -> str:
    ends = "" if low is None or high is None else rf" {{\scriptsize [{percent(low)}, {percent(high)}]}}"
    return percent(value) + ends

"""What the page's templates are filled with: sections, their selectors, and tables with their copies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from apil_core.studies.report.figures.plot import Plot
from apil_core.studies.report.models import Cell, Evidence, MethodDifference, Setting, Table
from apil_core.studies.report.words import amount

_LEGENDS = {
    "game": "Game",
    "measure": "Measure",
    "setting": "Setting",
    "kind": "Counted by",
    "score": "Score",
}

_WORDS = {"win": "win", "win_or_tie": "win or tie", "imitator": "imitator’s error"}

Options = Sequence[tuple[str, str]]
"""Value and label of each choice; values are joined by ``|``, the empty one stands for all."""


@dataclass(frozen=True)
class Facet:
    """A selector; its first option is chosen at first."""

    name: str
    legend: str
    options: Options


@dataclass(frozen=True)
class Section:
    """One section of the page.

    Attributes:
        key: its anchor.
        missing: the line that stands for it if it has no data.
        intro: paragraphs above it.
        legend: methods whose lines its figures have.
        chosen: options of facets, where not all and each.
    """

    key: str
    title: str
    template: str = "sections/figures.html.j2"
    missing: str = ""
    intro: Sequence[str] = ()
    plots: Sequence[Plot] = ()
    legend: Sequence[str] = ()
    chosen: dict[str, Options] = field(default_factory=dict)

    @property
    def facets(self) -> list[Facet]:
        """Selectors, of what figures differ in."""
        names = dict.fromkeys(name for plot in self.plots for name in plot.facets)
        facets = []
        for name in names:
            values = list(dict.fromkeys(plot.facets.get(name, "") for plot in self.plots))
            if len(values) > 1:
                each = [(value, _WORDS.get(value, value)) for value in values]
                options = self.chosen.get(name) or [("", "all"), *each]
                facets.append(Facet(name, _LEGENDS[name], [o for o in options if _useful(o[0], values)]))
        return facets


def _useful(choice: str, values: Sequence[str]) -> bool:
    return not choice or bool(set(choice.split("|")) & set(values))


@dataclass(frozen=True)
class Copy:
    """The text of a table, to be taken along."""

    key: str
    name: str
    file: str
    text: str


@dataclass(frozen=True)
class TableView:
    """A table with what belongs to it.

    Attributes:
        first: its number's main setting; others are folded.
    """

    table: Table
    setting: Setting
    first: bool
    differences: Sequence[MethodDifference]
    copies: Sequence[Copy]

    @property
    def key(self) -> str:
        """Its anchor."""
        return f"table-{self.table.id}"

    def column_marks(self, column: str) -> list[str]:
        """What all measured cells of a column are marked with; said once, above it."""
        cells = [cell for row in self.table.rows for cell in row if cell.column == column and cell.scores]
        return [mark for mark in cells[0].marks if all(mark in c.marks for c in cells)] if cells else []

    def cell_marks(self, cell: Cell) -> list[str]:
        """What else a cell is marked with."""
        said = self.column_marks(cell.column)
        return [mark for mark in cell.marks if mark not in said]

    def steps(self, cell: Cell) -> str:
        """What its agents were trained for."""
        found = sorted({score.steps for score in cell.scores if score.steps is not None})
        return ", ".join(amount(steps) for steps in found) or "–"


def table_views(evidence: Evidence) -> list[TableView]:
    """All tables by number, each number's main setting first."""
    order = [setting.id for setting in evidence.settings]
    views: list[TableView] = []
    for table in sorted(evidence.tables, key=lambda table: (table.number, order.index(table.setting))):
        first = not any(view.table.number == table.number for view in views)
        views.append(
            TableView(
                table=table,
                setting=evidence.setting(table.setting),
                first=first,
                differences=[d for d in evidence.differences if d.table == table.id],
                copies=_copies(evidence, table),
            )
        )
    return views


def _copies(evidence: Evidence, table: Table) -> list[Copy]:
    from apil_core.studies.report.latex import latex_table
    from apil_core.studies.report.markdown import markdown_table
    from apil_core.studies.report.tables import csv_text, table_rows

    texts = {
        ("Markdown", "md"): markdown_table(evidence, table),
        ("LaTeX", "tex"): latex_table(evidence, table),
        ("CSV", "csv"): csv_text(table_rows(evidence, table)),
    }
    return [
        Copy(f"copy-{table.id}-{suffix}", name, f"{table.id}.{suffix}", text)
        for (name, suffix), text in texts.items()
    ]

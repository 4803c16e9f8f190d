"""Tables as the page shows them: with their notes, differences, and copies in LaTeX and CSV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from apil_core.studies.report.models import ReportData
from apil_core.studies.report.table_models import Cell, MethodDifference, Setting, Table
from apil_core.studies.report.words import amount


@dataclass(frozen=True)
class Copy:
    """The text of a table, to be copied or saved as a file."""

    file: str
    text: str

    @property
    def key(self) -> str:
        """Id of its element."""
        return f"copy-{self.file.replace('.', '-')}"

    @property
    def name(self) -> str:
        """Its format."""
        return "CSV" if self.file.endswith(".csv") else "LaTeX"


@dataclass(frozen=True)
class TableView:
    """A table with its notes and exports.

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

    @property
    def columns(self) -> list[str]:
        """Columns with anything measured or published."""
        cells = [cell for row in self.table.rows for cell in row]
        filled = {cell.column for cell in cells if cell.scores or cell.win.published is not None}
        return [column for column in self.table.columns if column in filled]

    def column_marks(self, column: str) -> list[str]:
        """Labels that all measured cells of a column share; shown once, in its header."""
        cells = [cell for row in self.table.rows for cell in row if cell.column == column and cell.scores]
        return [mark for mark in cells[0].marks if all(mark in c.marks for c in cells)] if cells else []

    def cell_marks(self, cell: Cell) -> list[str]:
        """Labels of a cell besides those of its column."""
        above = self.column_marks(cell.column)
        return [mark for mark in cell.marks if mark not in above]

    def steps(self, cell: Cell) -> str:
        """Training budget of its agents."""
        found = sorted({score.steps for score in cell.scores if score.steps is not None})
        return ", ".join(amount(steps) for steps in found) or "–"


def table_views(data: ReportData, texts: Mapping[str, str]) -> list[TableView]:
    """All tables by number, each number's main setting first; ``texts`` of their files by name."""
    order = [setting.id for setting in data.settings]
    views: list[TableView] = []
    for table in sorted(data.tables, key=lambda table: (table.number, order.index(table.setting))):
        views.append(
            TableView(
                table=table,
                setting=data.setting(table.setting),
                first=not any(view.table.number == table.number for view in views),
                differences=[d for d in data.differences if d.table == table.id],
                copies=[Copy(file, texts[file]) for file in (f"{table.id}.tex", f"{table.id}.csv")],
            )
        )
    return views

"""The paper's four tables, shipped with the package."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import Any

from pydantic import BaseModel

from apil_core.common.errors import ConfigError
from apil_core.studies.report.table_models import Side

FILE = "published_results.json"


class PublishedTable(BaseModel):
    """One of the paper's tables.

    Attributes:
        rows: by game, then by column: (win, win+tie) as fractions.
    """

    number: int
    side: Side
    rows: dict[str, dict[str, tuple[float, float]]]

    def value(self, game: str, column: str) -> tuple[float, float] | None:
        """Win and win+tie, or ``None`` if that cell was not published."""
        return self.rows.get(game, {}).get(column)


class Published(BaseModel):
    """The results in the paper.

    Attributes:
        columns: ``baseline`` and the paper's methods, in its order.
        tables: by number, 1 to 4.
        games: in its order.
        episodes: games behind each cell.
        adversary_steps, retrain_steps: training budgets.
    """

    source: str
    columns: list[str]
    tables: dict[int, PublishedTable]
    games: list[str]
    episodes: int
    adversary_steps: int
    retrain_steps: int


@cache
def published() -> Published:
    """Read the tables from the package, once.

    Raises:
        ConfigError: the installation is incomplete.
    """
    file = resources.files("apil_core.studies.report") / FILE
    try:
        data = json.loads(file.read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"{file} is missing: install apil again") from error
    budgets, columns = data["budgets"], data["columns"]
    tables = [_table(entry, columns) for entry in data["tables"].values()]
    return Published(
        source=data["source"],
        columns=columns,
        tables={table.number: table for table in tables},
        games=list(tables[0].rows),
        episodes=budgets["eval_episodes"],
        adversary_steps=budgets["adversary_steps"],
        retrain_steps=budgets["retrain_steps"],
    )


def _table(entry: dict[str, Any], columns: list[str]) -> PublishedTable:
    rows = {
        game: {
            column: (win / 100, either / 100) for column, (win, either) in zip(columns, cells, strict=True)
        }
        for game, cells in entry.items()
        if isinstance(cells, list)
    }
    return PublishedTable(number=entry["paper_table"], side=entry["side"], rows=rows)

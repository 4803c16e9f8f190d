"""The report's tables as files: CSV with every number, LaTeX for print."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from apil_core.common.errors import RunDirError
from apil_core.common.files import write_atomically
from apil_core.common.visible import visible
from apil_core.evaluation.crossplay.document import CrossPlay
from apil_core.studies.report.figures.crossplay import setting_of
from apil_core.studies.report.latex import latex_aggregates, latex_table
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.statistics import THRESHOLDS
from apil_core.studies.report.table_models import Cell, Figure, Table

Row = Mapping[str, Any]


def write_tables(data: ReportData, directory: Path) -> list[Path]:
    """Write all tables: ``t1-s1.csv``, ``.tex``, …; ``differences.csv`` and others.

    Args:
        data: from :func:`apil_core.studies.report.report_data.gather`.
        directory: made if it is not there.

    Returns:
        The files.

    Raises:
        RunDirError: they cannot be written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunDirError(f"cannot make {directory}: {error.strerror}") from error
    return [_write(directory / name, text) for name, text in table_texts(data).items()]


def table_texts(data: ReportData) -> dict[str, str]:
    """Text of every table by file name."""
    texts: dict[str, str] = {}
    for table in data.tables:
        texts[f"{table.id}.tex"] = latex_table(data, table)
        texts[f"{table.id}.csv"] = csv_text(table_rows(data, table))
    for setting in data.settings:
        if any(each.setting == setting.id for each in data.aggregates):
            texts[f"aggregates-{setting.id}.tex"] = latex_aggregates(data, setting)
    lists = {name: list(rows) for name, rows in _lists(data).items()}
    return texts | {f"{name}.csv": csv_text(rows) for name, rows in lists.items() if rows}


def _write(path: Path, text: str) -> Path:
    write_atomically(path, lambda file: file.write(visible(text).encode()))
    return path


def csv_text(rows: Iterable[Row]) -> str:
    """Format rows as CSV with all their columns."""
    listed = list(rows)
    names = list(dict.fromkeys(name for row in listed for name in row))
    out = io.StringIO()
    writer = csv.DictWriter(out, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _no_formula(value) for key, value in row.items()} for row in listed)
    return out.getvalue()


def _no_formula(value: Any) -> Any:
    """Prefix an apostrophe to a text that a spreadsheet would evaluate as a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in tuple("=+-@\t\r") else value


def table_rows(data: ReportData, table: Table) -> Iterable[Row]:
    """One row per cell and share, with everything the share depends on; shares are fractions."""
    setting = data.setting(table.setting)
    names = (
        "steps",
        "retrain_steps",
        "published_steps",
        "budget_share",
        "trained_physics",
        "physics",
        "victim",
    )
    shared: dict[str, Any] = {"table": table.number, "side": table.side, "setting": setting.label}
    shared |= {name: getattr(setting, name) for name in (*names, "adversary_actions", "victim_actions")}
    shared["blind"] = table.blind
    for cell in (cell for row in table.rows for cell in row):
        for name, figure in (("win", cell.win), ("win_or_tie", cell.win_or_tie)):
            yield {**shared, **_figure_row(cell, name, figure)}


def _figure_row(cell: Cell, name: str, figure: Figure) -> Row:
    measured = {} if figure.measured is None else figure.measured.model_dump()
    difference = {} if figure.difference is None else figure.difference.model_dump()
    spread = ("low", "high", "interval", "sd", "minimum", "maximum")
    return {
        "game": cell.game,
        "column": cell.column,
        "share": name,
        "published": figure.published,
        "measured": measured.get("value"),
        **{each: measured.get(each) for each in spread},
        "per_seed": _joined(measured.get("per_seed", ())),
        "difference": difference.get("value"),
        "difference_low": difference.get("low"),
        "difference_high": difference.get("high"),
        "verdict": figure.verdict,
        "seeds": cell.seeds,
        "seed_names": _joined(score.seed for score in cell.scores),
        "episodes": cell.episodes,
        "marks": "; ".join(cell.marks),
        "sources": "; ".join(score.source for score in cell.scores),
    }


def _joined(values: Iterable[Any]) -> str:
    return " ".join(str(value) for value in values)


def _lists(data: ReportData) -> dict[str, Iterable[Row]]:
    labels = {setting.id: setting.label for setting in data.settings}

    def flat(entries: Sequence[Any], *drop: str) -> Iterable[Row]:
        for entry in entries:
            row = {k: v for k, v in entry.model_dump(mode="json").items() if k not in drop}
            if "setting" in row:
                row["setting"] = labels.get(row["setting"], row["setting"])
            yield _flattened(row)

    return {
        "differences": flat(data.differences),
        "aggregates": flat(data.aggregates),
        "profiles": (
            {**row, "score_above": threshold, **dict(zip(("value", "low", "high"), ends, strict=True))}
            for each, row in zip(data.profiles, flat(data.profiles, "value", "low", "high"), strict=True)
            for threshold, *ends in zip(THRESHOLDS, each.value, each.low, each.high, strict=True)
        ),
        "improvements": flat(data.improvements),
        "endings": (
            _flattened({"table": table.id, "setting": labels[table.setting], **_endings(cell)})
            for table in data.tables
            if table.number in (1, 2)
            for cell in table.cells
        ),
        "ablations": (row for ablation in data.ablations for row in _ablation_rows(ablation, labels)),
        "crossplay": (row for matrix in data.crossplay for row in _crossplay_rows(matrix)),
        "claims": (
            {"claim": claim.claim, "setting": labels[claim.setting], **check.model_dump()}
            for claim in data.claims
            for check in claim.checks
        ),
        "warnings": flat(data.warnings),
        "unfinished": flat(data.unfinished),
        "runs": flat(data.provenance.runs),
    }


def _endings(cell: Cell) -> Row:
    """How the games of a cell ended, all seeds together."""
    return {
        "game": cell.game,
        "column": cell.column,
        "episodes": cell.episodes,
        **{count: cell.total(count) for count in ("wins", "ties", "losses")},
        "causes": cell.causes,
        "mean_length": sum(score.mean_length * score.episodes for score in cell.scores) / cell.episodes,
    }


def _flattened(row: Mapping[str, Any]) -> Row:
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}/{key}": inner for key, inner in value.items()}
        else:
            flat[name] = _joined(value) if isinstance(value, list) else value
    return flat


def _ablation_rows(ablation: Any, labels: Mapping[str, str]) -> Iterable[Row]:
    for row in ablation.rows:
        yield {
            "axis": ablation.axis,
            "value": row.value,
            "game": ablation.game,
            "method": ablation.method,
            "setting": labels[ablation.setting],
            "win": row.cell.win.measured.value,
            "win_or_tie": row.cell.win_or_tie.measured.value,
            "win_verdict": row.difference and row.difference.win_verdict,
            "win_or_tie_verdict": row.difference and row.difference.win_or_tie_verdict,
            "seeds": row.cell.seeds,
            "episodes": row.cell.episodes,
            "imitator_error": row.imitator_error,
        }


def _crossplay_rows(document: CrossPlay) -> Iterable[Row]:
    for adversary, row in zip(document.adversaries, document.scores, strict=True):
        for victim, score in zip(document.victims, row, strict=True):
            if score is not None:
                rates = {"win": score.win_rate, "win_or_tie": score.win_or_tie_rate}
                yield {
                    "game": document.env,
                    "adversary": adversary.label,
                    "victim": victim.label,
                    "setting": setting_of(document),
                    **{f"{name}_{end}": value for name, rate in rates.items() for end, value in rate},
                }

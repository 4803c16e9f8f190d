"""``apil runs list | compare | plot``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from apil_core.cli.app import sub_app
from apil_core.cli.flags import Json
from apil_core.cli.output import console, emit, print_json, say, table
from apil_core.cli.readout import game_name, percent
from apil_core.common.errors import ConfigError, RunDirError

if TYPE_CHECKING:
    from apil_core.studies.comparison import Comparison, Difference
    from apil_core.training.storage.run_dir import RunDir

app = sub_app("runs", "List runs, compare their scores, draw their learning curves.")
app.command("apil_core.cli.plot:plot", name="plot")


@app.command(name="list")
def list_(
    root: Annotated[Path, Parameter(name="ROOT", help="Directory to look below.")] = Path("runs"),
    /,
    *,
    as_json: Json = False,
) -> None:
    """List runs: what was trained, how far it is, and its final score."""
    from apil_core.training.storage.run_dir import DEFAULT_ROOT
    from apil_core.training.storage.run_list import list_runs

    if not root.is_dir() and (root.exists() or root != DEFAULT_ROOT):  # before the first run there is none
        raise RunDirError(f"{root} is no directory")
    found = [entry for run in list_runs(root) if (entry := _entry(run)) is not None]
    if as_json:
        print_json(found)
        return
    rows = table("run", "method", "game", "victim", "seed>", "steps>", "status", "win>", "win or tie>")
    for entry in found:
        win, win_or_tie = (_share(entry["evaluation"], key) for key in ("win_rate", "win_or_tie_rate"))
        numbers = (str(entry["seed"]), f"{entry['steps']:,}")
        method = f"{entry['method']} (white box)" if entry.get("white_box") else entry["method"]
        names = (entry["path"], method, game_name(entry["env"], entry["physics"]), entry["victim"])
        status = ": ".join(filter(None, (entry["status"], entry.get("stopped"))))
        rows.add_row(*names, *numbers, status, win, win_or_tie)
    console().print(rows if found else f"no runs below {root}")


@app.command
def compare(
    *directories: Annotated[
        Path,
        Parameter(name="DIR", required=True, help="Runs, or directories of several; the first is the base."),
    ],
    as_json: Json = False,
) -> None:
    """Compare final scores with the first run's; differences that chance explains are marked."""
    from apil_core.studies.comparison import compare as side_by_side
    from apil_core.training.storage.run_list import runs_in

    result = side_by_side(runs_in(directories))
    for warning in result.warnings:
        say(f"apil: {warning}")
    emit(result, as_json, lambda: print_comparison(result))


def _entry(run: RunDir) -> dict[str, Any] | None:
    """One row of the listing, ``None`` for a retraining; if a run cannot be read, the row has the error."""
    from apil_core.config.game import stored_physics
    from apil_core.config.kind import IsRetrainingError
    from apil_core.training.storage.run_dir import scored_victim

    try:
        config, summary = run.config(), run.summary()
    except IsRetrainingError:
        return None
    except (ConfigError, RunDirError) as error:
        return {
            "path": str(run.path), "method": "?", "env": "?", "physics": None, "victim": "?",
            "seed": 0, "steps": 0, "status": str(error).splitlines()[0], "evaluation": None,
        }  # fmt: skip
    names = {"method": config.method, "env": config.env, "physics": stored_physics(config)}
    return {**names, "victim": scored_victim(summary) or config.victim, "seed": config.seed, **summary}


def _share(evaluation: dict[str, Any] | None, key: str) -> str:
    rate = (evaluation or {}).get(key)
    return f"{100 * rate['value']:.1f} %" if rate else "–"


def print_comparison(result: Comparison) -> None:
    """Print scores side by side, and their mean over seeds."""
    columns = (
        *("run", "method", "game", "victim", "seed>", "steps>", "games>"),
        *("win>", "difference", "win or tie>", "difference"),
    )
    rows = [
        (
            *(row.run, row.method, game_name(row.env, row.physics), row.victim),
            *(str(row.seed), f"{row.steps:,}", str(row.episodes)),
            *(percent(row.win) if row.win else "–", _difference(row.win_difference)),
            *(percent(row.win_or_tie) if row.win_or_tie else "–", _difference(row.win_or_tie_difference)),
        )
        for row in result.rows
    ]
    console().print(table(*columns, rows=rows))
    means = ("win mean ± sd>", "win or tie mean ± sd>")
    spreads = [
        (
            *(spread.method, spread.env, spread.victim, f"{spread.steps:,}", str(len(spread.seeds))),
            f"{100 * spread.win_mean:.1f} ± {100 * spread.win_sd:.1f} %",
            f"{100 * spread.win_or_tie_mean:.1f} ± {100 * spread.win_or_tie_sd:.1f} %",
        )
        for spread in result.spreads
    ]
    if spreads:
        console().print(table("method", "game", "victim", "steps>", "seeds>", *means, rows=spreads))


def _difference(change: Difference | None) -> str:
    if change is None:
        return ""
    interval = f"[{100 * change.low:+.1f}, {100 * change.high:+.1f}]"
    noise = " within noise" if change.within_noise else ""
    return f"{100 * change.value:+.1f} {interval}{noise}"

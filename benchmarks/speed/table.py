"""Tables of the measurements."""

from __future__ import annotations

from pathlib import Path

from apil_core.cli.output import console, table

from .report import CAPTIONS, Cell, HookCost, SpeedReport, SpeedRow, of_setting


def print_report(report: SpeedReport, out: Path | None) -> None:
    """Print the machine, a table for each setting, and the paths of the files."""
    screen, machine = console(), report.machine
    screen.print(
        f"{machine.cpu}, {machine.usable_cpus} of {machine.cpus} CPUs; "
        f"load {machine.load_before:.1f} before, {machine.load_after:.1f} after",
        markup=False,
    )
    for cell in report.cells:
        screen.print(f"\n{_title(cell)}", style="bold", markup=False)
        rows = of_setting(report.rows, cell)
        base = rows[0].ratio_to
        shown = table("level", "method", "steps/s>", f"÷ {base}>", "peak memory, MB>")
        for row in rows:
            shown.add_row(*_cells(row))
        screen.print(shown)
        if base != "physics":
            screen.print("this game's physics cannot be timed alone: ratios are to rules and observations")
        for cost in of_setting(report.hooks, cell):
            screen.print(_hooks(cost), markup=False)
        screen.print(_memory(cell), markup=False)
        if not cell.same_games:
            screen.print(
                "careful: games played again went another way, so that game and victim did other work",
                style="yellow",
            )
    if out is not None and report.cells:
        screen.print(f"\nreport     {out / 'speed.json'}\npicture    {out / 'speed.png'}", markup=False)


def _title(cell: Cell) -> str:
    profile = f" ({cell.physics})" if cell.physics else ""
    threads = f"{cell.threads} thread{'s' * (cell.threads != 1)}"
    blocks = f"{cell.rounds} rounds of {cell.num_steps} steps"
    return f"{cell.env}{profile} against {cell.victim}, {cell.num_envs} games, {threads}, {blocks}"


def _cells(row: SpeedRow) -> list[str]:
    rate, ratio = row.steps_per_second, row.ratio
    return [
        CAPTIONS[row.level],
        row.method or "",
        f"{rate.median:,.0f} [{rate.low:,.0f}, {rate.high:,.0f}]",
        f"{ratio.median:.3f} [{ratio.low:.3f}, {ratio.high:.3f}]",
        f"{row.memory_mb:,.0f}",
    ]


def _hooks(cost: HookCost) -> str:
    share = f"{100 * cost.dispatch.median:.3f} %"
    return f"hooks, {cost.method}: {cost.calls} calls an iteration, {share} of its time"


def _memory(cell: Cell) -> str:
    seen = "" if cell.peak_exact else " (seen between blocks)"
    return (
        "memory of the process, which holds all trainings of the setting, MB: "
        f"{cell.resident_before_mb:,.0f} before, {cell.resident_after_mb:,.0f} after, "
        f"at most {cell.peak_mb:,.0f}{seen}"
    )

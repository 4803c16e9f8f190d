"""Writes the physics settings' tables into ``docs/fidelity.md``, draws ``docs/images/physics-frontier.png``.

    python docs/make_frontier.py [--rows ROWS.jsonl] [--speeds SPEEDS.jsonl] [--page PAGE] [--picture PICTURE]

The rows are what ``apil fidelity --physics … --out`` and ``--variant … --out`` kept (default:
``docs/results/physics_frontier.jsonl``); faithful games they lack come from ``docs/results/fidelity.jsonl``.
The speeds are rows ``{"env", "setting": {option: value}, "ratio", "low", "high"}`` (default:
``docs/results/physics_speed.jsonl``).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from frontier import LIMIT, Point, points, profile, read_speeds
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from apil_core.common.colours import LINES
from apil_core.common.errors import ApilError
from apil_core.common.statistics import Difference
from apil_core.evaluation.fidelity.rows import read_rows
from apil_core.evaluation.results import wilson
from apil_envs.options import PhysicsProfile

HERE = Path(__file__).parent
BEGIN, END = "<!-- made by make_frontier.py -->", "<!-- end of what make_frontier.py made -->"
CAPTION = "Speed against deviation from faithful of each physics setting, one panel per game"
RATES = ("win", "win+tie", "tie")


def name(env: str, setting: PhysicsProfile) -> str:
    """``fast: Newton, leapfrog, 5 × 0.003 s``."""
    known = [each for each in ("faithful", "fast") if profile(env, each) == setting]
    parts = [setting.solver, setting.integrator, f"{setting.substeps} × {setting.timestep:g} s"]
    parts += ["refreshed"] if setting.refresh else []
    return f"{known[0]}: {', '.join(parts)}" if known else ", ".join(parts)


def by_game(found: Sequence[Point]) -> dict[str, list[Point]]:
    games: dict[str, list[Point]] = {}
    for point in found:
        games.setdefault(point.pair.env, []).append(point)
    return games


def in_points(rate: Difference) -> str:
    return f"{100 * rate.value:+.1f} [{100 * rate.low:+.1f}, {100 * rate.high:+.1f}]"


def table(found: Sequence[Point]) -> list[str]:
    """One game's."""
    lines = [
        "| setting | speed | pairing | games | win % | win | win+tie | tie | within 4 points |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for point in found:
        speed, counts = point.speed, point.counts
        win = wilson(counts.wins, counts.games)
        ratio = "–" if speed is None else f"{speed.ratio:.2f} [{speed.low:.2f}, {speed.high:.2f}]"
        cells = [
            name(point.pair.env, point.setting),
            ratio if point.differences else "1",
            str(point.pair),
            str(counts.games),
            f"{100 * win.value:.1f} [{100 * win.low:.1f}, {100 * win.high:.1f}]",
            *(in_points(point.differences[rate]) if point.differences else "–" for rate in RATES),
            point.verdict if point.differences else "–",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def text(found: Sequence[Point]) -> str:
    parts = [f"![{CAPTION}](images/physics-frontier.png)", ""]
    for env, of_game in by_game(found).items():
        parts += [f"### Settings of {env}", "", *table(of_game), ""]
    return "\n".join(parts).rstrip()


def draw(found: Sequence[Point], path: Path) -> None:
    """A panel per game: deviation of each rate over speed, both with their intervals."""
    games = by_game([point for point in found if point.differences and point.speed])
    rows = -(-len(games) // 2) or 1
    figure = Figure(figsize=(10.4, 3.4 * rows + 0.6), layout="constrained")
    figure.subplots(rows, 2, squeeze=False)
    for axes, (env, of_game) in zip(figure.axes, games.items(), strict=False):
        _panel(axes, env, of_game)
    for unused in figure.axes[len(games) :]:
        unused.set_visible(False)
    if games:
        figure.axes[0].legend(frameon=False, fontsize=8, loc="upper left")
    figure.suptitle(
        "Physics settings: speed against deviation from faithful, with 95 % intervals; "
        "band: 4 points; filled: the fast profile",
        fontsize=10,
    )
    figure.savefig(path, dpi=120)


def _panel(axes: Axes, env: str, of_game: Sequence[Point]) -> None:
    axes.axhspan(-100 * LIMIT, 100 * LIMIT, color="#e4e6ea", zorder=0)
    axes.axhline(0, color="#60666f", linewidth=0.8)
    fast = profile(env, "fast")
    for number, rate in enumerate(RATES):
        colour = tuple(channel / 255 for channel in LINES[number])
        for place, point in enumerate(of_game):
            assert point.speed is not None
            gap, speed = point.differences[rate], point.speed
            # moved apart a little, to be seen
            x = speed.ratio * (1 + 0.012 * (number - 1) + 0.004 * (place % 3))
            axes.errorbar(
                x,
                100 * gap.value,
                xerr=[[speed.ratio - speed.low], [speed.high - speed.ratio]],
                yerr=[[100 * (gap.value - gap.low)], [100 * (gap.high - gap.value)]],
                marker="osD"[number],
                markersize=5,
                markerfacecolor=colour if point.setting == fast else "white",
                color=colour,
                linewidth=1,
                label=rate if place == 0 else None,
            )
    axes.set_title(env, loc="left", fontsize=10)
    axes.set_xlabel("speed, multiple of faithful", fontsize=9)
    axes.set_ylabel("deviation, points", fontsize=9)


def write_section(page: Path, made: str) -> None:
    before, begin, rest = page.read_text("utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise SystemExit(f"{page} has no line {BEGIN!r} … {END!r}")
    page.write_text(f"{before}{BEGIN}\n\n{made}\n\n{END}{after}", "utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rows", type=Path, default=HERE / "results" / "physics_frontier.jsonl")
    parser.add_argument("--speeds", type=Path, default=HERE / "results" / "physics_speed.jsonl")
    parser.add_argument("--page", type=Path, default=HERE / "fidelity.md")
    parser.add_argument("--picture", type=Path, default=HERE / "images" / "physics-frontier.png")
    given = parser.parse_args(arguments)
    try:
        known = read_rows(HERE / "results" / "fidelity.jsonl")
        found = points(read_rows(given.rows), known, read_speeds(given.speeds))
    except ApilError as error:
        raise SystemExit(f"make_frontier.py: {error}") from error
    draw(found, given.picture)
    write_section(given.page, text(found))


if __name__ == "__main__":
    main()

"""``apil fidelity``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from apil_core.cli.flags import Flags, Json, Quiet, flags_of
from apil_core.cli.output import console, emit, table
from apil_core.cli.progress import make_progress
from apil_core.cli.readout import percent
from apil_core.common.errors import ConfigError
from apil_core.evaluation.options import FidelityOptions

if TYPE_CHECKING:
    from apil_core.api.specs import GameSpec
    from apil_core.evaluation.fidelity.plan import SkippedMatchup
    from apil_core.evaluation.fidelity.rows import FidelityRow, Figure
    from apil_core.plugins.discovery import PluginRegistry

WEIGHTS_MISSING = 1
"""Exit code where there were pairings, and weights for none of them."""


@flags_of(
    FidelityOptions,
    {
        None: (
            *("physics", "seed", "num_envs", "threads", "plugin_files"),
            *("episodes", "switches", "switch_episodes", "variants"),
        )
    },
)
class FidelityFlags(Flags):
    """Flags for the games to play."""

    def options(self) -> FidelityOptions:
        """The options these flags stand for.

        Raises:
            ConfigError: a value that makes no sense.
        """
        given = self.given()
        files, texts = (given.pop(key, ()) for key in ("plugin_files", "variants"))
        variants = tuple(map(_assignments, texts))
        return FidelityOptions(**given, plugin_files=tuple(map(str, files)), variants=variants)


def fidelity(
    *,
    flags: FidelityFlags | None = None,
    game: Annotated[list[str] | None, Parameter(help="Only this game; repeatable [default: all].")] = None,
    out: Annotated[
        Path | None,
        Parameter(help="Keep finished rows in this file, and play only those not yet in it."),
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> int:
    """Play the published pairings of pretrained agents and compare with the published scores.

    Scores are the adversary's, with Wilson 95 % intervals; differences are measured minus published,
    with Newcombe 95 % intervals. "agrees" means that 0 lies in that interval, and no more than that.
    """
    from apil_core.evaluation.fidelity.plan import no_profiles, plan_rows
    from apil_core.evaluation.fidelity.play import missing_policy, play_rows
    from apil_core.plugins.discovery import discover

    options = (flags or FidelityFlags()).options()
    plugins = discover(options.plugin_files)
    games = _games(plugins, game)
    named = games if game and options.physics is not None else ()  # others are skipped silently
    for reason in filter(None, map(no_profiles, named)):
        raise ConfigError(reason)
    plan = plan_rows(games, options, missing_policy(plugins))
    with make_progress(quiet=quiet) as progress:
        rows = play_rows(plan.rows, plugins=plugins, threads=options.threads, progress=progress, out=out)
    emit({"rows": rows, "skipped": plan.skipped}, as_json, lambda: _print(rows, plan.skipped))
    return WEIGHTS_MISSING if plan.skipped and not rows else 0


def _games(plugins: PluginRegistry, names: list[str] | None) -> list[GameSpec]:
    from apil_core.plugins.registry import game_spec

    if names:
        return [game_spec(name, plugins) for name in dict.fromkeys(names)]
    return list(plugins.games.values())


def _assignments(text: str) -> dict[str, Any]:
    """Parse ``a=1,b=x`` into a mapping; values are read as YAML."""
    from apil_core.config.layers import parse_yaml

    pairs = [part.partition("=") for part in text.split(",")]
    if not all(key.strip() and equals for key, equals, _ in pairs):
        raise ConfigError(
            f"--variant {text}: expected key=value,key=value, e.g. solver=Newton,integrator=Euler"
        )
    lines = "\n".join(f"{key.strip()}: {value}" for key, _, value in pairs)
    return parse_yaml(lines, f"--variant {text}")[0]


def _print(rows: list[FidelityRow], skipped: list[SkippedMatchup]) -> None:
    out = console()
    if rows:
        columns = ("game", "adversary", "victim", "actions", "games>", "figure", "measured>", "published>")
        lines = [
            (*(_who(row) if name == "win" else [""] * 5), name, *_cells(figure))
            for row in rows
            for name, figure in (("win", row.win), ("win+tie", row.win_or_tie))
        ]
        out.print(table(*columns, "difference in points", rows=lines))
        for row in rows:
            ranked = sorted(row.result.causes.items(), key=lambda item: -item[1])
            endings = ", ".join(f"{name} {count}" for name, count in ranked)
            facts = f"mean length {row.result.mean_length:.0f}, {row.result.wall_seconds:.0f} s"
            out.print(f"{row.plan.title}: {endings}; {facts}")
    else:
        why = "their weights are not on this machine" if skipped else "none of the games names a pairing"
        out.print(f"nothing played: {why}")
    for row in {row.plan.adversary: row for row in rows if row.plan.stands_in_for}.values():
        out.print(f"* {row.plan.adversary} stands in for {row.plan.stands_in_for}")
    for matchup in skipped:
        out.print(f"skipped {matchup.env}, {matchup.adversary}: {matchup.reason}")


def _who(row: FidelityRow) -> list[str]:
    plan = row.plan
    adversary = f"{plan.adversary}*" if plan.stands_in_for else plan.adversary
    return [plan.env, adversary, plan.victim, plan.setting, str(row.result.episodes)]


def _cells(figure: Figure) -> list[str]:
    published = "–" if figure.published is None else f"{figure.published:g} %"
    return [percent(figure.measured), published, figure.verdict]

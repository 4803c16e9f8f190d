"""An evaluation as a table for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core.cli.output import console, table

if TYPE_CHECKING:
    from apil_core.evaluation import EvaluationResult

_HOW = {"sample": "sampled", "mode": "mode"}


def print_score(result: EvaluationResult) -> None:
    """Win, tie and loss with 95 % intervals, endings, and everything the numbers depend on."""
    out = console()
    title = f"{result.adversary.name} against {result.victim.name} in {result.env}, {result.episodes} games"
    out.print(title, style="bold", markup=False)
    rows = table("adversary's", "games>", "share>", "95 % interval>")
    for name, count, rate in (
        ("win", result.wins, result.win_rate),
        ("tie", result.ties, result.tie_rate),
        ("loss", result.losses, result.loss_rate),
        ("win or tie", result.wins + result.ties, result.win_or_tie_rate),
    ):
        interval = f"{100 * rate.low:.1f} – {100 * rate.high:.1f} %"
        rows.add_row(name, str(count), f"{100 * rate.value:.1f} %", interval)
    out.print(rows)
    for line in _facts(result):
        out.print(line, markup=False)


def _facts(result: EvaluationResult) -> list[str]:
    ranked = sorted(result.causes.items(), key=lambda item: -item[1])
    endings = ", ".join(f"{name} {count}" for name, count in ranked)
    trained = "" if result.trained_steps is None else f", trained {result.trained_steps:,} steps"
    facts = [
        f"endings    {endings}; mean length {result.mean_length:.0f} steps",
        f"adversary  {result.adversary.name} ({_short(result.adversary.sha256)}), "
        f"actions {_HOW[result.adversary_actions]}{trained}",
        f"victim     {result.victim.name} ({_short(result.victim.sha256)}), "
        f"actions {_HOW[result.victim_actions]}",
        f"seed       {result.seed}, {result.num_envs} games in parallel, {result.wall_seconds:.1f} s",
    ]
    if result.blind is not None:
        imitator = ", its methods too" if result.blind_imitator else ""
        facts.append(f"blinded    the adversary does not see its opponent ({result.blind}){imitator}")
    if result.game_options:
        options = ", ".join(f"{key} {value}" for key, value in result.game_options.items())
        facts.append(f"game       {options}")
    return facts


def _short(digest: str) -> str:
    return f"sha256 {digest[:12]}" if digest else "no hash"

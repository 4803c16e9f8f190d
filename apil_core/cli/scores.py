"""Tables of evaluations for the terminal."""

from __future__ import annotations

import shlex
import statistics
from collections.abc import Sequence
from typing import TYPE_CHECKING

from apil_core.api.profiles import FAITHFUL
from apil_core.cli.output import console, table
from apil_core.cli.readout import percent, physics, share
from apil_core.evaluation.results import in_words

if TYPE_CHECKING:
    from apil_core.evaluation.results import EvaluationResult

_HOW = {"sample": "sampled", "mode": "mode"}


def print_score(result: EvaluationResult) -> None:
    """Print win, tie and loss with 95 % intervals, endings, and everything the numbers depend on."""
    out = console()
    title = f"{result.adversary.name} against {result.victim.name} in {result.env}, {result.episodes} games"
    title += physics(result)
    out.print(title, style="bold")
    rows = [
        ("win", str(result.wins), *share(result.win_rate)),
        ("tie", str(result.ties), *share(result.tie_rate)),
        ("loss", str(result.losses), *share(result.loss_rate)),
        ("win or tie", str(result.wins + result.ties), *share(result.win_or_tie_rate)),
    ]
    out.print(table("adversary's", "games>", "share>", "95 % interval>", rows=rows))
    for line in _facts(result):
        out.print(line)


def print_scores(results: Sequence[EvaluationResult]) -> None:
    """Print several adversaries' scores, one line each, and the mean and standard deviation over them."""
    rows = table("adversary", "games>", "win>", "tie>", "loss>", "win or tie>")
    names = ("win_rate", "tie_rate", "loss_rate", "win_or_tie_rate")
    for result in results:
        rates = [percent(getattr(result, name)) for name in names]
        rows.add_row(result.adversary.name, str(result.episodes), *rates)
    if len(results) > 1:
        columns = [[100 * getattr(result, name).value for result in results] for name in names]
        spread = [f"{statistics.mean(column):.1f} ± {statistics.stdev(column):.1f} %" for column in columns]
        rows.add_row("mean ± sd", "", *spread)
    console().print(rows)
    for line in _facts(results[0])[2:]:
        console().print(line)


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
    if result.blind_victim is not None:
        facts.append(f"blinded    the victim does not see its opponent ({result.blind_victim})")
    if result.white_box:
        facts.append("white box  the adversary's method saw inside the victim in training")
    facts += [f"observer   {text}" for text in in_words(result.observers or {})]
    if played := result.options_played:
        facts.append(f"game       {', '.join(f'{key} {value}' for key, value in played.items())}")
    if (hint := true_rules_hint(result)) is not None:
        facts.append(hint)
    return facts


def true_rules_hint(result: EvaluationResult) -> str | None:
    """The command for scoring an adversary in the faithful game, where this score is of another profile."""
    name = result.adversary.name
    if not name.startswith("run:") or result.physics in (None, FAITHFUL):
        return None
    return f"hint       under the game's true physics: apil eval {shlex.quote(name)} --physics faithful"


def _short(digest: str) -> str:
    return f"sha256 {digest[:12]}" if digest else "no hash"

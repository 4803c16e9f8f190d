"""Cross-play as a table for people."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from apil_core.cli.output import console, table
from apil_core.cli.readout import percent, physics

if TYPE_CHECKING:
    from apil_core.evaluation.crossplay.document import CrossPlay

_UP, _LEFT = "≈↑", "≈←"


def print_crossplay(document: CrossPlay, out: Path | None = None, picture: Path | None = None) -> None:
    """A row for each adversary and share, a column for each victim; then who they are."""
    from apil_core.evaluation.crossplay.document import SHARES, share_of

    screen, some = console(), document.played[0]
    title = f"{document.env}, {some.episodes:,} games a cell, the adversary's share{physics(some)}"
    screen.print(title, style="bold", markup=False)
    marks = _marks(document)
    shown = table("adversary", "", *(f"{_plain(player.label)}>" for player in document.victims))
    for i, adversary in enumerate(document.adversaries):
        for share in SHARES:
            cells = []
            for j, victim in enumerate(document.victims):
                score = document.scores[i][j]
                mark = marks.get((share, adversary.label, victim.label), "")
                cells.append("–" if score is None else f"{percent(share_of(score, share))} {mark}".rstrip())
            first = share == SHARES[0]
            shown.add_row(
                _plain(adversary.label) if first else "", share.replace("_or_", "+"), *map(_plain, cells)
            )
    screen.print(shown)
    for line in _legend(document):
        screen.print(line, markup=False)
    for side, players in (("adversary", document.adversaries), ("victim", document.victims)):
        for player in players:
            who = f"{player.name} (sha256 {player.sha256[:12]})"
            screen.print(
                f"{side:<10} {player.label}: {who}" if player.label != player.name else f"{side:<10} {who}",
                markup=False,
            )
    modes = f"actions {some.adversary_actions}/{some.victim_actions}"
    screen.print(f"games      seed {some.seed}, {some.num_envs} in parallel, {modes}", markup=False)
    for name, path in (("scores", out), ("picture", picture)):
        if path is not None:
            screen.print(f"{name:<10} {path}", markup=False)


def _marks(document: CrossPlay) -> dict[tuple[str, str, str], str]:
    """What a cell does not differ from by more than noise, by share, adversary and victim."""
    from apil_core.evaluation.crossplay.document import comparisons

    marks: dict[tuple[str, str, str], list[str]] = {}
    for each in comparisons(document):
        if each.difference.within_noise:
            mark = _UP if each.base_victim == each.victim else _LEFT
            marks.setdefault((each.share, each.adversary, each.victim), []).append(mark)
    return {cell: " ".join(found) for cell, found in marks.items()}


def _legend(document: CrossPlay) -> list[str]:
    first, original = document.adversaries[0].label, document.victims[0].label
    lines = []
    if len(document.adversaries) > 1:
        lines.append(f"{_UP} no more than noise from {first} against the same victim (Newcombe 95 %)")
    if len(document.victims) > 1:
        lines.append(f"{_LEFT} no more than noise from the same adversary against {original} (Newcombe 95 %)")
    return lines


def _plain(text: str) -> str:
    """Brackets as they are, not as markup."""
    from rich.markup import escape

    return escape(text)

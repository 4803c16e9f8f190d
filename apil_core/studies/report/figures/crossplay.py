"""Cross-play as a heat map: every adversary against every victim."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core.evaluation.crossplay.document import CrossPlay, Share, share_of
from apil_core.studies.report.figures.palette import GROUND
from apil_core.studies.report.figures.plot import WIDTH, Plot
from apil_core.studies.report.words import percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MEASURES = {"win": "games won by the adversary", "win_or_tie": "games won or tied by the adversary"}
_CELL = (0.95, 0.42)  # inches
_LETTER = 0.07  # inches, of the labels' font


def crossplay_map(document: CrossPlay, share: Share) -> Plot:
    """Draw a cross-play's heat map of one measure."""
    victims = [player.label for player in document.victims]
    cell = max(_CELL[0], _LETTER * max(map(len, victims)))
    names = _LETTER * max(len(player.label) for player in document.adversaries)

    def draw(axis: Axes) -> None:
        from apil_core.evaluation.crossplay.heat_map import draw_matrix

        draw_matrix(axis, document, share, ground=GROUND)
        axis.grid(visible=False)

    words = [
        f"{adversary.label} against "
        + ", ".join(
            f"{victim.label} {'not yet' if score is None else f'{percent(share_of(score, share).value)} %'}"
            for victim, score in zip(document.victims, row, strict=True)
        )
        for adversary, row in zip(document.adversaries, document.scores, strict=True)
    ]
    return Plot(
        draw,
        title=f"{document.env}: {_MEASURES[share]}, %",
        alt=f"Cross-play in {document.env}: {_MEASURES[share]}. {'. '.join(words)}.",
        caption=f"{setting_of(document)}.",
        facets={"game": document.env, "measure": share},
        wide=cell * len(victims) + names + 0.4 > WIDTH,
        height=0.6 + _CELL[1] * len(document.adversaries),
    )


def setting_of(document: CrossPlay) -> str:
    """Describe the setting: games, physics, action modes."""
    first = document.played[0]
    games = sorted({score.episodes for score in document.played})
    facts = [f"{games[0]} games each" if len(games) == 1 else f"{games[0]} to {games[-1]} games each"]
    facts += [f"{first.physics} physics"] if first.physics else []
    facts.append(f"actions {first.adversary_actions}/{first.victim_actions}")
    return ", ".join(facts)

"""Results of cross-play as data: a score for every adversary against every victim."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, Self, get_args

from pydantic import BaseModel, model_validator

from apil_core.common.documents import JsonDocument
from apil_core.common.statistics import Difference
from apil_core.evaluation.results import EvaluationResult, PolicyId, Rate, gap

Share = Literal["win", "win_or_tie"]
"""Games the adversary won; games it did not lose."""

SHARES: tuple[Share, ...] = get_args(Share)


class Player(PolicyId):
    """One player.

    Attributes:
        label: of its row or column.
        method, seed: of the run that trained it, or ``None`` for other policies.
    """

    label: str
    method: str | None = None
    seed: int | None = None


class CrossPlay(JsonDocument):
    """Every adversary against every victim of one game.

    Attributes:
        scores: (adversaries, victims), the adversary's; ``None`` where nothing has been played yet.
    """

    maker = "apil crossplay"

    env: str
    adversaries: list[Player]
    victims: list[Player]
    scores: list[list[EvaluationResult | None]]

    @model_validator(mode="after")
    def _rectangular(self) -> Self:
        if [len(row) for row in self.scores] != [len(self.victims)] * len(self.adversaries):
            raise ValueError("scores must have a row for each adversary and a column for each victim")
        return self

    @property
    def played(self) -> list[EvaluationResult]:
        """The existing scores, row by row."""
        return [score for row in self.scores for score in row if score is not None]

    @property
    def complete(self) -> bool:
        """True if every pairing has been played."""
        return all(score is not None for row in self.scores for score in row)

    def score(self, adversary: str, victim: str) -> EvaluationResult | None:
        """The score of two players, by label; ``None`` if it is not there."""
        rows, columns = ([player.label for player in side] for side in (self.adversaries, self.victims))
        if adversary not in rows or victim not in columns:
            return None
        return self.scores[rows.index(adversary)][columns.index(victim)]


class Comparison(BaseModel):
    """A cell beside the first one of its column (another adversary) or of its row (another victim)."""

    share: Share
    adversary: str
    victim: str
    base_adversary: str
    base_victim: str
    difference: Difference


def share_of(score: EvaluationResult, share: Share) -> Rate:
    """The given share with its interval."""
    return score.win_rate if share == "win" else score.win_or_tie_rate


def comparisons(document: CrossPlay) -> list[Comparison]:
    """Every cell beside the first row's and the first column's, with Newcombe's 95 % intervals."""
    return [found for share in SHARES for found in _comparisons(document, share)]


def _comparisons(document: CrossPlay, share: Share) -> Iterator[Comparison]:
    for i, row in enumerate(document.scores):
        for j, score in enumerate(row):
            bases = ([(0, j)] if i else []) + ([(i, 0)] if j else [])
            for a, v in bases:
                base = document.scores[a][v]
                if score is not None and base is not None:
                    yield Comparison(
                        share=share,
                        adversary=document.adversaries[i].label,
                        victim=document.victims[j].label,
                        base_adversary=document.adversaries[a].label,
                        base_victim=document.victims[v].label,
                        difference=gap(score, base, ties=share == "win_or_tie"),
                    )

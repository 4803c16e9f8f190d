"""Scores of adversaries that are no runs of the report: baselines, named ones of a matrix, stored results."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import ValidationError

from apil_core.common.errors import ConfigError
from apil_core.common.files import read_json
from apil_core.evaluation.crossplay.document import CrossPlay
from apil_core.evaluation.results import EvaluationResult
from apil_core.studies.bench.matrix import BASELINE

_NO_WEIGHTS = {"run": "a run", "baseline": "no weights", "python": "Python code", "scripted": "a script"}


@dataclass(frozen=True)
class Replayed:
    """One score of an adversary that is no run of the report.

    Attributes:
        label: of its column.
        file: where the score is stored, unless in a benchmark's directory.
        alone: if no run was scored in the same games, it gets a table of its own.
    """

    label: str
    score: EvaluationResult
    file: str = ""
    alone: bool = False

    @property
    def note(self) -> str:
        """What it is, for readers of a table; empty for a game's own opponent."""
        if self.label == BASELINE:
            return ""
        what = _NO_WEIGHTS.get(self.score.adversary.name.partition(":")[0], "published weights")
        return f"{what}, replayed here" if not self.file else f"{what}, score from {Path(self.file).name}"

    @property
    def source(self) -> str:
        """Policy, hash and file."""
        who = self.score.adversary
        if self.label == BASELINE:
            return who.name
        stored = f", {self.file}" if self.file else ""
        return f"{who.name}, SHA-256 {who.sha256[:12] or 'unknown'}{stored}"


def read_stored(path: Path) -> EvaluationResult | CrossPlay:
    """Read a score of ``apil eval`` (``--keep``, ``--json``) or a cross-play (``--out``).

    Raises:
        ConfigError: it is neither, or its victim was blinded.
        RunDirError: it cannot be read.
    """
    if "adversaries" in read_json(path):
        return CrossPlay.read(path)
    try:
        score = EvaluationResult.model_validate_json(path.read_bytes())
    except ValidationError as error:
        raise ConfigError(
            f"{path} is neither a score of apil eval nor a cross-play of apil crossplay"
        ) from error
    if score.blind_victim is not None:
        raise ConfigError(f"{path}: its victim was blinded, and reports have no table of blinded victims")
    return score


def replayed_in(path: Path, found: EvaluationResult | CrossPlay, runs: Collection[str]) -> Iterator[Replayed]:
    """The scores in a file, except those of ``runs``, named ``run:…``, which have scores of their own."""
    if isinstance(found, EvaluationResult):
        yield Replayed(path.stem, found, str(path), alone=True)
        return
    for player, row in zip(found.adversaries, found.scores, strict=True):
        if player.name not in runs:
            yield from (Replayed(player.label, score, str(path)) for score in row if score is not None)


def relabelled(replayed: Sequence[Replayed], methods: Collection[str]) -> list[Replayed]:
    """Tell labels that are also the names of methods from these."""
    return [
        replace(each, label=f"{each.label} ({Path(each.file).stem or 'replayed'})")
        if each.label in methods
        else each
        for each in replayed
    ]

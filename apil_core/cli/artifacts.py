"""Artifacts of a finished run: scores to compare with, its learning curve, a video of a game it won."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from apil_core.common.errors import ApilError
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.training.storage.run_dir import RunDir

Made = TypeVar("Made")

TRIES = 30
"""Games searched for one that the adversary wins."""


class RunArtifacts(BaseModel):
    """Artifacts of a run; ``None`` where one could not be made; ``notes`` has the reason.

    Attributes:
        opponent: score of the game's own opponent of the victim, in the games of the run's own score.
        victim_blinded: the run's score against a victim that does not see it; wins beyond that are due to the
            victim's observation of the adversary.
        curve, won_game: files.
        notes: artifacts that could not be made, with reasons.
    """

    opponent: EvaluationResult | None = None
    victim_blinded: EvaluationResult | None = None
    curve: Path | None = None
    won_game: Path | None = None
    notes: list[str] = []


def make_artifacts(run: RunDir, progress: Progress | None = None) -> RunArtifacts:
    """Play the comparison games, draw the learning curve and record a game that the adversary wins.

    They are optional, so an artifact that cannot be made is a note, not an error.

    Args:
        run: a finished run. Files of the same names are replaced.
        progress: gets a note of every game tried.
    """
    made = RunArtifacts()
    progress = progress or Progress()
    if run.config().evaluation.episodes:
        lack = "no score of the game's own opponent"
        made.opponent = _attempt(made, lack, lambda: _own_opponent(run, progress))
        lack = "no score against a blinded victim"
        made.victim_blinded = _attempt(
            made, lack, lambda: _score(run, progress, run.path, blind_victim="zeros")
        )
    made.curve = _attempt(made, "no learning curve", lambda: _draw(run))
    made.won_game = _attempt(made, "no video of a won game", lambda: _record_win(run, progress))
    return made


def _attempt(made: RunArtifacts, lack: str, make: Callable[[], Made]) -> Made | None:
    try:
        return make()
    except Exception as error:  # OpenGL, encoder or disk; further seeds may still have to run
        kind = "" if isinstance(error, ApilError) else f"{type(error).__name__}: "
        made.notes.append(f"{lack}: {kind}{error}")
        return None


def _own_opponent(run: RunDir, progress: Progress) -> EvaluationResult | None:
    from apil_core.plugins.default_victim import default_baseline
    from apil_core.plugins.discovery import discover

    config = run.config()
    plugins = discover(config.plugins)
    spec = plugins.game(config.env)
    name = default_baseline(spec, plugins)
    if not name or config.victim_side not in (None, spec.victim_side):  # it plays in one seat only
        return None
    return _score(run, progress, name, like=config, plugins=plugins, trust=config.trust)


def _score(run: RunDir, progress: Progress, name: Path | str, **options: Any) -> EvaluationResult:
    """Score an adversary in the games of the run's own score."""
    from apil_core.evaluation.options import EvaluationOptions
    from apil_core.evaluation.score import evaluate

    config = run.config()
    shared = EvaluationOptions(
        episodes=config.evaluation.episodes, seed=config.seed, threads=config.threads, device=config.device
    )
    return evaluate(name, shared, progress=progress, **options)


def _draw(run: RunDir) -> Path:
    from apil_core.studies.curves.groups import read_groups
    from apil_core.studies.curves.picture import draw_curves

    draw_curves(read_groups([run]), run.curve_path)
    return run.curve_path


def _record_win(run: RunDir, progress: Progress) -> Path:
    from apil_core.evaluation.options import RenderOptions
    from apil_core.evaluation.pairing import load_pairing
    from apil_core.evaluation.video.recording import check_files, show

    config = run.config()
    path = run.won_game_path
    path.unlink(missing_ok=True)
    options = RenderOptions(seed=config.seed, episodes=TRIES, until="win", video=path)
    check_files(options)
    with load_pairing(run.path, num_envs=1, threads=1, seed=config.seed, device=config.device) as pairing:
        show(pairing, options, progress)
    return path

"""End of ``apil run`` and ``apil resume``: output, artifacts and exit code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.cli.guard import INTERRUPTED, complain
from apil_core.cli.output import print_facts, say
from apil_core.common.errors import ApilError
from apil_core.training.distributed.world import World

if TYPE_CHECKING:
    from apil_core.cli.artifacts import RunArtifacts
    from apil_core.evaluation.progress import Progress
    from apil_core.evaluation.results import EvaluationResult
    from apil_core.runs.runner import RunResult


def finish(result: RunResult, progress: Progress, *, show: bool, as_json: bool) -> dict[str, Any]:
    """Print how a run ended, make its artifacts if requested, and print where they are.

    Returns:
        what ``--json`` prints, with a key ``souvenirs`` if any artifact was made.
    """
    document = result.model_dump(mode="json")
    if not as_json:
        print_end(result)
    if show and result.status == "finished":
        document["souvenirs"] = _artifacts(result, progress, silent=as_json)
    return document


def print_end(result: RunResult) -> None:
    """Print the final score (or the present state of the run) and the likely next command."""
    from apil_core.cli.output import console
    from apil_core.cli.readout import imitator
    from apil_core.cli.scores import print_score
    from apil_core.training.storage.run_dir import RunDir

    if result.evaluation is not None:
        print_score(result.evaluation)
    if result.best is not None:
        rate, steps = result.best["wins"] / result.best["games"], result.best["steps"]
        how = f"score it: apil eval {result.run_dir} --checkpoint best"
        console().print(f"best       {rate:.1%} wins at {steps:,} steps; {how}")
    if imitates := imitator(RunDir(result.run_dir).last_metrics()):
        console().print(f"imitator   {imitates}")
    if result.status == "finished":
        console().print(f"run        {result.run_dir}, {result.steps:,} steps")


def _artifacts(result: RunResult, progress: Progress, *, silent: bool) -> dict[str, Any]:
    from apil_core.cli.artifacts import make_artifacts
    from apil_core.training.storage.run_dir import RunDir

    progress.note("playing games to compare with, drawing the learning curve, looking for a won game")
    made = make_artifacts(RunDir(result.run_dir), progress)
    for note in made.notes:
        complain(note, 0)
    if not silent:
        if result.evaluation is not None:
            _print_beside(result.evaluation, made)
        print_facts(curve=made.curve, won_game=made.won_game)
    return made.model_dump(mode="json")


def _print_beside(own: EvaluationResult, made: RunArtifacts) -> None:
    """Print the wins of the adversary, of the game's own opponent, and against the blinded victim."""
    from apil_core.cli.output import console, table
    from apil_core.cli.readout import share

    scores = {"this adversary": own}
    if made.opponent is not None:
        scores[f"the game's own opponent, {made.opponent.adversary.name}"] = made.opponent
    if made.victim_blinded is not None:
        scores["this adversary, unseen by the victim"] = made.victim_blinded
    rows = [(who, str(score.episodes), *share(score.win_rate)) for who, score in scores.items()]
    console().print(table("against the same victim", "games>", "wins>", "95 % interval>", rows=rows))


def draw_curve(path: Path, draw: Callable[[], object], *, silent: bool = False) -> None:
    """Draw a learning curve and print where it is; it is optional, so a failure is only a note."""
    try:
        draw()
    except ApilError as error:  # too few games have ended, or matplotlib is missing
        complain(f"no learning curve: {error}", 0)
    else:
        print_facts(curve=None if silent else path)


def exit_code(result: RunResult, world: World) -> int:
    """Return 0, or 130 after Ctrl-C; the first process prints how to continue."""
    if result.status == "finished":
        return 0
    if world.is_main:
        how = f"continue with: {world.command} resume {result.run_dir}"
        say(f"apil: interrupted at {result.steps} steps; {how}")
    return INTERRUPTED

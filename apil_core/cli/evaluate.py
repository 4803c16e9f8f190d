"""``apil eval``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from apil_core.cli.flags import ADVERSARY, EvaluationFlags, Json, Quiet
from apil_core.cli.output import emit
from apil_core.cli.progress import make_progress
from apil_core.cli.scores import print_score, print_scores
from apil_core.common.errors import ConfigError
from apil_core.evaluation.options import EvaluationOptions


def evaluate(
    adversary: Annotated[str, ADVERSARY],
    /,
    *,
    flags: EvaluationFlags | None = None,
    keep: Annotated[
        str | None,
        Parameter(
            metavar="NAME",
            help="Keep the score for apil bench report: NAME with the run, as RUN/scores/NAME.json; "
            "FILE.json, of any adversary, in that file.",
        ),
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Score an adversary: win, tie and loss rates with Wilson 95 % intervals, and how games ended.

    The same seed gives the same games at any number of threads. Of a directory of several runs each is
    scored, and their mean over seeds is printed.
    """
    from apil_core.evaluation.score import evaluate as score

    options = (flags or EvaluationFlags()).options(EvaluationOptions)
    if keep is not None and options.blind_victim is not None:
        raise ConfigError("--keep: reports have no table of blinded victims; use --json with --blind-victim")
    adversaries = _runs_below(adversary)
    if keep is not None and keep.endswith(".json") and len(adversaries) > 1:
        raise ConfigError(f"--keep {keep}: {adversary} holds several runs; give a name, kept with each")
    kept = [None if keep is None else _keeping(name, keep) for name in adversaries]
    results = []
    for name, path in zip(adversaries, kept, strict=True):
        with make_progress(quiet=quiet) as progress:
            results.append(score(name, options, progress=progress))
        if path is not None:
            from apil_core.studies.bench.folder import write_result

            write_result(path, results[-1])
    if adversaries == [adversary]:
        emit(results[0], as_json, lambda: print_score(results[0]))
    else:
        emit(results, as_json, lambda: print_scores(results))


def _runs_below(adversary: str) -> list[str]:
    """The runs in a directory that is none itself; else the name alone."""
    from apil_core.training.storage.run_list import runs_in

    path = Path(adversary)
    if not path.is_dir() or (path / "config.yaml").is_file():
        return [adversary]
    return [str(run.path) for run in runs_in([path])]


def _keeping(adversary: str, name: str) -> Path:
    """Check that a score of that name can be stored, before any game is played; return the file's path.

    Raises:
        ConfigError: the name is none, or taken, or is no file's and there is no run.
        ApilError: nothing can be written there.
    """
    from apil_core.common.files import check_place
    from apil_core.studies.bench.folder import score_path
    from apil_core.studies.bench.matrix import PLAIN, check_name
    from apil_core.training.export.run_policy import RunCheckpoint, run_path

    path = run_path(adversary)
    if name.endswith(".json"):
        kept = Path(name)
    elif path is None:
        raise ConfigError(f"--keep {name}: {adversary} is no run; name a file, e.g. --keep {name}.json")
    elif name == PLAIN:
        raise ConfigError(f"--keep {name}: that is the score the run ended with; choose another name")
    else:
        try:
            check_name(name, f"--keep {name}")
        except ValueError as error:
            raise ConfigError(str(error)) from error
        kept = score_path(RunCheckpoint.find(path).run_dir.path, name)
    if kept.exists():
        raise ConfigError(f"--keep {name}: {kept} exists, and no score is overwritten; choose another name")
    check_place(kept if kept.parent.exists() else kept.parent)
    return kept

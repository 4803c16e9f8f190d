"""``check_method``: check a method against the whole contract, fast checks first."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from apil_core.api.specs import MethodSpec
from apil_core.testing import method_calls, method_play, method_runs, method_spec
from apil_core.testing.method_runs import WatchedRun
from apil_core.testing.method_under_test import MethodUnderTest, find
from apil_core.testing.reports import MethodReport


def check_method(
    method: MethodSpec | str,
    *,
    plugins: Sequence[str | Path] = (),
    options: Mapping[str, Any] | None = None,
    env: str = "toy-pursuit",
) -> MethodReport:
    """Run every check of docs/testing.md on a method; some are runs of a fraction of a second each.

    docs/testing.md lists the checks in order and shows a failure.

    Args:
        method: a spec, or the name of an installed method or one that ``plugins`` offer.
        plugins: files of one-file plugins.
        options: of the method, as under ``options.<name>``; default: its defaults.
        env: the game to try it on.

    Returns:
        the checks made, and the cost of its hooks; ``print`` it.

    Raises:
        ContractError: the first check that fails.
        UnknownNameError: no method or game has that name.
    """
    begin = time.process_time()
    tested = find(method, plugins, options, env)
    with torch.random.fork_rng(devices=[]), tempfile.TemporaryDirectory() as folder:
        without_a_run(tested)
        run = in_runs(tested, Path(folder))
    hooks, seconds = method_calls.costs(tested, run)
    return MethodReport(
        name=tested.name,
        env=env,
        checked=tested.checked(),
        skipped=tested.skipped,
        hooks=hooks,
        seconds_per_step=seconds,
        num_envs=run.config.num_envs,
        seconds=time.process_time() - begin,
    )


def without_a_run(tested: MethodUnderTest) -> None:
    """Check spec, module, options, marks, answers, and the state as built."""
    method_spec.check_spec(tested)
    with tested.check("import"):
        method_spec.check_import(tested, tested.registry, "methods", tested.name)
    with tested.check("options"):
        method_spec.check_options(tested, tested.spec.config)
    methods, hooks = method_runs.built(tested)
    method_spec.check_marks(tested, methods[tested.name], hooks)
    method_spec.check_answers(tested, hooks)
    method_runs.check_state(tested, methods[tested.name], "as built")


def in_runs(tested: MethodUnderTest, folder: Path) -> WatchedRun:
    """Run the remaining checks; runs are stored in ``folder``."""
    run = method_runs.watched_run(tested, folder / "watched")
    method_calls.check_calls(tested, run)
    method_runs.check_state(tested, run.trainer.attack.methods[tested.name], "after training")
    method_runs.check_same_seed(tested, run, folder / "again")
    method_runs.check_other_seed(tested)
    method_runs.check_resume(tested, run, folder / "resumed")
    method_play.check_playing(tested, run)
    method_play.check_export(tested, run)
    method_runs.check_sizes(tested, folder)
    method_runs.check_companions(tested, folder / "companions")
    return run

"""``check_method``: a method through the whole contract, the cheap parts first."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from apil_core.api.specs import MethodSpec
from apil_core.testing import method_calls, method_play, method_runs, method_spec
from apil_core.testing.promises import METHOD_PROMISES
from apil_core.testing.reports import MethodReport
from apil_core.testing.subject import Subject, find


def check_method(
    method: MethodSpec | str,
    *,
    plugins: Sequence[str | Path] = (),
    options: Mapping[str, Any] | None = None,
    env: str = "toy-pursuit",
) -> MethodReport:
    """Whether a method keeps every promise of docs/hooks.md; some runs of a fraction of a second each.

    What is checked, in which order, and what a failure looks like: docs/testing.md.

    Args:
        method: a spec, or the name of an installed method or one that ``plugins`` offer.
        plugins: files of one-file plugins.
        options: of the method, as under ``options.<name>``; default: its defaults.
        env: the game to try it on.

    Returns:
        what was checked, and what its hooks cost; ``print`` it.

    Raises:
        ContractError: the first promise that is broken.
        UnknownNameError: no method or game has that name.
    """
    begin = time.process_time()
    subject = find(method, plugins, options, env)
    with torch.random.fork_rng(devices=[]), tempfile.TemporaryDirectory() as folder:
        without_a_run(subject)
        report = in_runs(subject, Path(folder))
    unchecked = {text.split(":")[0].capitalize() for text in subject.skipped}
    report.checked = [p.title for p in METHOD_PROMISES.values() if p.title not in unchecked]
    report.skipped = subject.skipped
    report.seconds = time.process_time() - begin
    return report


def without_a_run(subject: Subject) -> None:
    """Spec, module, options, marks, answers, and the state as built.

    Raises:
        ContractError: one of them is wrong.
    """
    method_spec.check_spec(subject)
    spec, who = subject.spec, subject.who
    with_reason = method_spec.check_import(
        who, METHOD_PROMISES["import"], subject.registry, "methods", spec.name
    )
    if with_reason is not None:
        subject.skipped.append(with_reason)
    method_spec.check_options(who, METHOD_PROMISES["options"], spec.config)
    methods, hooks = method_runs.built(subject)
    method = methods[spec.name]
    method_spec.check_marks(subject, method, hooks)
    method_spec.check_answers(subject, hooks)
    method_runs.check_state(subject, method, "as built")


def in_runs(subject: Subject, folder: Path) -> MethodReport:
    """Everything else; runs go below ``folder``.

    Raises:
        ContractError: one of the promises is broken.
    """
    run = method_runs.watched_run(subject, folder / "watched")
    method_calls.check_calls(subject, run)
    method_runs.check_state(subject, run.trainer.attack.methods[subject.spec.name], "after training")
    method_runs.check_same_seed(subject, run, folder / "again")
    method_runs.check_other_seed(subject)
    method_runs.check_resume(subject, run, folder / "resumed")
    method_play.check_playing(subject, run)
    method_runs.check_sizes(subject, folder)
    method_runs.check_company(subject, folder / "company")
    hooks, seconds = method_calls.costs(subject, run)
    return MethodReport(
        name=subject.spec.name,
        env=subject.env,
        hooks=hooks,
        seconds_per_step=seconds,
        num_envs=run.config.num_envs,
    )

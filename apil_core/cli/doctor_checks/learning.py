"""The learner's libraries, and the GPU they might use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from apil_core.cli.doctor_checks.finding import Finding, error, good, listed
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.cli.doctor_checks.trial import TrialError, attempt


def check(scope: Scope) -> Iterator[Finding]:
    """Whether what training needs can be imported, and what torch sees."""
    try:
        facts = attempt("libraries")
    except TrialError as reason:
        remedy = "pip install --force-reinstall --no-deps the package it names, or a new environment"
        yield error("learner", f"cannot be imported: {reason}", remedy)
        return
    text = f"imported in {facts['seconds']:.1f} s; torch {facts['torch']} (threads: {facts['threads']})"
    yield good("learner", f"{text}, results are made on one thread")
    yield gpu(facts["gpus"])


def gpu(names: Sequence[str]) -> Finding:
    """What to say of the GPUs torch can use; none is as good as any."""
    if not names:
        return good("gpu", "none that torch can use; none is needed")
    detail = f"{listed(names)}: --device cuda is meant to work, but was never tested by us"
    return good("gpu", f"{detail}; physics runs on the CPU in any case")

"""The Lemma applied to a run: the KL between successive adversaries, and the bound it implies.

A diagnostic, not a guarantee: measured values replace the largest KL over all states, and H.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import BaseModel

from apil_core.common.errors import ConfigError, RunDirError
from apil_core.studies.curves.curves import Line
from apil_core.studies.theory.bounds import informative_kl, lemma_bound
from apil_core.training.storage.recorders import read_metrics
from apil_core.training.storage.run_dir import RunDir

KL, KL_MAX, IMITATOR_KL, BOUND = "kl", "kl_max", "imitator_kl", "bound"
"""Names of the lines; the second and third exist only if the run logged them."""

_METRICS = {KL: "ppo/kl", KL_MAX: "ppo/kl_max", IMITATOR_KL: "apil/imitator_kl"}
_RETURN = "return/victim"


class Diagnostics(BaseModel):
    """The Lemma's quantities over a run's training, and the resulting bound. KL is in bits.

    Attributes:
        run: its directory.
        steps: of training so far.
        value_bound: H, the largest |V_ν(s)|, in the units of the training reward.
        value_bound_from: the caller, or the log's returns (largest mean return of the games that ended in a
            row, in the game's reward: the training's is that times its weights).
        trivial_bound: 2H, which holds without any theorem.
        informative_kl: from this KL on the Lemma says no more than that.
        informative_share: share of rows whose KL is smaller.
        lines: over steps. :data:`KL`: KL(old ‖ new) of the adversary's network over a whole update, mean over
            the rollout's states; :data:`KL_MAX`: the largest of them; :data:`IMITATOR_KL`: as the first, for
            the imitator; :data:`BOUND`: the Lemma with the first in place of the largest over all states.
        notes: caveats.
    """

    run: str
    env: str
    method: str
    seed: int
    steps: int
    gamma: float
    value_bound: float
    value_bound_from: Literal["given", "returns"]
    trivial_bound: float
    informative_kl: float
    informative_share: float
    lines: dict[str, Line]
    notes: list[str]


def diagnose(run: RunDir, *, value_bound: float | None = None) -> Diagnostics:
    """Compute the diagnostics from a run's log.

    Args:
        run: its directory, finished or not.
        value_bound: H, if it is known.

    Raises:
        ConfigError: ``value_bound`` is negative or not finite.
        RunDirError: no run there, or its log is damaged or has no KL or no ended game.
    """
    if value_bound is not None and not 0 <= value_bound < math.inf:
        raise ConfigError(f"value_bound must be a finite number of at least 0, got {value_bound}")
    config = run.config()
    rows = read_metrics(run.metrics_path)
    lines = {name: line for name, metric in _METRICS.items() if (line := _line(rows, metric)).steps}
    if KL not in lines:
        raise RunDirError(f"{run.metrics_path} has no {_METRICS[KL]}: there is nothing to make a bound of")
    largest, source = _value_bound(run, rows, value_bound)
    gamma, limit = config.ppo.gamma, informative_kl(config.ppo.gamma)
    bounds = [lemma_bound(largest, value, gamma) for value in lines[KL].value]
    lines[BOUND] = Line(steps=lines[KL].steps, value=bounds)
    result = Diagnostics(
        run=str(run.path),
        env=config.env,
        method=config.method,
        seed=config.seed,
        steps=int(rows[-1]["steps"]),
        gamma=gamma,
        value_bound=largest,
        value_bound_from=source,
        trivial_bound=2 * largest,
        informative_kl=limit,
        informative_share=float(np.mean([value < limit for value in lines[KL].value])),
        lines=lines,
        notes=[],
    )
    result.notes = _notes(result, merged=any("row_iterations" in row for row in rows))
    return result


def _line(rows: Sequence[Mapping[str, float]], metric: str) -> Line:
    """Convert nats to bits; clip the -1e-9 that rounding leaves where an update changed next to nothing."""
    kept = [row for row in rows if math.isfinite(row.get(metric, math.nan))]
    bits = [max(row[metric], 0.0) / math.log(2) for row in kept]
    return Line(steps=[int(row["steps"]) for row in kept], value=bits)


def _value_bound(
    run: RunDir,
    rows: Sequence[Mapping[str, float]],
    given: float | None,
) -> tuple[float, Literal["given", "returns"]]:
    if given is not None:
        return given, "given"
    returns = [abs(row[_RETURN]) for row in rows if math.isfinite(row.get(_RETURN, math.nan))]
    if not returns:
        raise RunDirError(f"{run.metrics_path}: no game has ended, so nothing tells how large a value can be")
    return max(returns), "returns"


def _notes(result: Diagnostics, *, merged: bool) -> list[str]:
    sources = {
        "given": "was given",
        "returns": "is the largest mean return of the victim in a row of the log, so it may be too small",
    }
    notes = [
        "KL is the mean over the states of each rollout; the Lemma wants the largest over all states. "
        "So the bound is a diagnostic, not a guarantee.",
        f"H = {result.value_bound:.3g} {sources[result.value_bound_from]}.",
        f"At γ = {result.gamma:g} the Lemma says more than the trivial 2H = {result.trivial_bound:.3g} only "
        f"below {result.informative_kl:.2g} bits. That is so in {result.informative_share:.0%} of the rows.",
    ]
    if IMITATOR_KL in result.lines:
        notes.append(
            "KL is that of the adversary's network for given predictions; the imitator, which makes them, "
            "changes as well, by a KL of its own."
        )
    if merged:
        notes.append("Each row is a mean over several updates.")
    return notes

"""Curves of runs that differ in the seed only, merged: mean and standard deviation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel

from apil_core.common.errors import ConfigError, RunDirError
from apil_core.config.game import stored_game
from apil_core.studies.curves.curves import Curve, Line, read_curve
from apil_core.training.storage.run_dir import RunDir

_FREE: Any = {
    **dict.fromkeys(("seed", "threads", "device", "checkpoint", "recorders", "log_rows", "trust"), True),
    "evaluation": {"episodes", "every_steps", "periodic_episodes"},
}
"""Settings in which runs of one attack may differ."""


class CurveGroup(BaseModel):
    """One run, or several that differ in the seed only.

    Attributes:
        label: distinguishes it from the other groups.
        curves: of its runs.
        lines: by name; of several runs their mean, with a band of one standard deviation to either side.
    """

    label: str
    curves: list[Curve]
    lines: dict[str, Line]

    @property
    def seeds(self) -> list[int]:
        """Seeds of its runs."""
        return [curve.seed for curve in self.curves]


def read_groups(runs: Sequence[RunDir], metrics: Sequence[str] = ()) -> list[CurveGroup]:
    """Read runs and group those that differ in the seed only, in the order given.

    Args:
        runs: their directories.
        metrics: see :func:`.curves.read_curve`.

    Raises:
        ApilError: as :func:`.curves.read_curve`; or a run is named twice, or seeds share no steps.
    """
    twice = [path for path, times in Counter(run.path.resolve() for run in runs).items() if times > 1]
    if twice:
        raise ConfigError(f"{twice[0]} is named twice")
    curves = [read_curve(run, metrics) for run in runs]
    members = [[curves[place] for place in group] for group in seed_groups(runs)]
    labels = _labels([group[0] for group in members])
    return [
        CurveGroup(label=label, curves=group, lines=_together(group))
        for label, group in zip(labels, members, strict=True)
    ]


def _labels(firsts: Sequence[Curve]) -> list[str]:
    """Shortest distinct labels: method, game, victim, physics where they differ; else the directory."""
    facts = [(c.method, c.env, c.victim, f"{c.physics} physics" if c.physics else "") for c in firsts]
    differing = [i for i in range(4) if len({fact[i] for fact in facts} - {""}) > 1] or [0]
    labels = [", ".join(fact[i] for i in differing if fact[i]) for fact in facts]
    times = Counter(labels)
    return [
        label if times[label] == 1 else f"{label} ({curve.run})"
        for label, curve in zip(labels, firsts, strict=True)
    ]


def _together(curves: Sequence[Curve]) -> dict[str, Line]:
    if len(curves) == 1:
        return curves[0].lines
    names = [name for name in curves[0].lines if all(name in curve.lines for curve in curves)]
    return {name: _mean([curve.lines[name] for curve in curves], curves) for name in names}


def _mean(lines: Sequence[Line], curves: Sequence[Curve]) -> Line:
    """Mean and standard deviation over the range that all lines cover, at the steps of the first."""
    begin, end = max(line.steps[0] for line in lines), min(line.steps[-1] for line in lines)
    steps = [step for step in lines[0].steps if begin <= step <= end]
    if not steps:
        names = ", ".join(curve.run for curve in curves)
        raise RunDirError(f"no mean over seeds: these runs have no steps in common: {names}")
    values = np.stack([np.interp(steps, line.steps, line.value) for line in lines])
    mean, sd = values.mean(0), values.std(0, ddof=1)
    return Line(steps=steps, value=mean.tolist(), low=(mean - sd).tolist(), high=(mean + sd).tolist())


def seed_groups(runs: Sequence[RunDir]) -> list[list[int]]:
    """Indices into ``runs``, grouped where they differ in the seed only; in the order given.

    The number of processes is part of the attack: each adds its games to the batch. Two runs of one
    attack with one seed go into two groups: they are copies, not evidence.

    Raises:
        ApilError: one of them is no run directory.
    """
    groups: dict[tuple[str, int], list[int]] = {}
    copies: dict[tuple[str, int], int] = {}
    for place, run in enumerate(runs):
        config = run.config()
        played = config.model_copy(update={"game": stored_game(config)})
        attack = f"{run.processes()} {played.model_dump_json(exclude=_FREE)}"
        copy = copies.get((attack, config.seed), 0)
        copies[attack, config.seed] = copy + 1
        groups.setdefault((attack, copy), []).append(place)
    return list(groups.values())

"""Labels of the rows and columns of a cross-play."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from apil_core.api.specs import GameSpec
from apil_core.common.errors import ConfigError
from apil_core.evaluation.crossplay.players import Names, run_config
from apil_core.plugins.registry import default_plugins
from apil_core.runs.retraining.folder import RetrainDir, is_retraining

AUTO, BASELINE, ORIGINAL = "auto", "baseline", "original"


def labelled(names: Sequence[str], labels: Sequence[str] | None, env: str | None, *, side: str) -> Names:
    """Names by label; a label defaults to the run's method, or ``original`` or ``baseline``.

    Args:
        names: runs or policy names.
        labels: one for each, or ``None``.
        env: the game, if the user named it.
        side: ``"adversary"`` or ``"victim"``.

    Raises:
        ConfigError: there are more or fewer labels than names, or two players have the same.
    """
    if labels is not None and len(labels) != len(names):
        raise ConfigError(f"{len(labels)} labels for {len(names)} names: one for each {side}")
    labels = labels or _default_labels(names, env, side)
    twice = [label for label, count in Counter(labels).items() if count > 1]
    if twice:
        raise ConfigError(f"two players are called {twice[0]!r}: give each {side} a label of its own")
    return dict(zip(labels, names, strict=True))


def _default_labels(names: Sequence[str], env: str | None, side: str) -> list[str]:
    configs = [run_config(name) for name in names]
    known = default_plugins().games
    spec = known.get(env or next((config.env for config in configs if config), ""))
    methods = Counter(config.method for config in configs if config)
    seeds = Counter((config.method, config.seed) for config in configs if config)
    labels = []
    for name, config in zip(names, configs, strict=True):
        if config is None:
            labels.append(_part(name, spec, side))
        elif methods[config.method] == 1:
            labels.append(config.method)
        elif seeds[config.method, config.seed] == 1:
            labels.append(f"{config.method}/s{config.seed}")
        else:
            labels.append(f"{config.method}/{Path(name).name}")
    return labels


def _part(name: str, spec: GameSpec | None, side: str) -> str:
    retrained = Path(name.removeprefix("retrained:"))
    if is_retraining(retrained):
        attackers = [label for label in RetrainDir(retrained).config().labels if label != BASELINE]
        return f"vs {'+'.join(attackers)}" if attackers else name
    if side == "victim" and name in (AUTO, "" if spec is None else spec.default_victim):
        return ORIGINAL
    return BASELINE if spec is not None and name == spec.baseline_adversary else name

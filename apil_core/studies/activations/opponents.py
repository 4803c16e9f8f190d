"""Whom a victim plays while its activations are recorded: normal play first, then everybody else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from apil_core.api.config import RunConfig
from apil_core.common.errors import ConfigError, VictimError
from apil_core.evaluation.crossplay.document import Player
from apil_core.evaluation.crossplay.players import (
    Lineup,
    Names,
    SharedOptions,
    check_unchanged,
    line_up,
    run_config,
)
from apil_core.evaluation.pairing import load_pairing
from apil_core.evaluation.progress import PartOfAll, Progress
from apil_core.plugins.registry import plugins_with
from apil_core.studies.activations.recording import Recorded, check_told, record

BASELINE = "baseline"
"""Label of normal play."""


@dataclass(frozen=True)
class Opponents:
    """Everybody, loaded once and found to fit.

    Attributes:
        names: runs or policy names by label, normal play first.
        victim: name of the one that is looked at.
        lineup: who they are.
    """

    names: Names
    victim: str
    lineup: Lineup


def gather(
    opponents: Names,
    victim: str | None,
    baseline: str | None,
    *,
    seed: int,
    num_envs: int,
    options: SharedOptions,
) -> Opponents:
    """Find out who plays; see :func:`apil_core.studies.activations.analysis.analyze`.

    Raises:
        ApilError: somebody cannot play, the runs attack different victims, or the victim is a black box.
    """
    runs = [config for name in opponents.values() if (config := run_config(name)) is not None]
    env = options.get("env") or next((config.env for config in runs), None)
    if env is None:
        raise ConfigError("say which game they play: --env GAME")
    if BASELINE in opponents and baseline is not None:
        raise ConfigError(f"{BASELINE!r} is the label of normal play: name its opponent once")
    normal = opponents.get(BASELINE) or baseline or _baseline_of(env, runs, options)
    names: dict[str, Path | str] = {BASELINE: normal}
    names |= {label: name for label, name in opponents.items() if label != BASELINE}
    attacked = victim or _attacked(runs)
    options = {**options, "env": env}
    lineup = line_up(
        names, {"victim": attacked}, seed=seed, num_envs=num_envs, options=options, look=check_told
    )
    if victim is None:
        _check_pinned(runs, lineup.victims[0])
    return Opponents(names, attacked, lineup)


def record_all(opponents: Opponents, games: int, seed: int, progress: Progress) -> dict[str, Recorded]:
    """The victim's activations in ``games`` games against each; normal play has twice as many.

    Args:
        opponents: who plays.
        games: against each.
        seed: of the games and all draws.
        progress: told of the games played, over all opponents.
    """
    lineup = opponents.lineup
    total = games * (len(opponents.names) + 1)
    recorded: dict[str, Recorded] = {}
    before = 0
    for (label, name), player in zip(opponents.names.items(), lineup.adversaries, strict=True):
        here = 2 * games if label == BASELINE else games
        with (
            load_pairing(
                name, num_envs=lineup.setting.num_envs, victim=opponents.victim, seed=seed, **lineup.options
            ) as pairing,
            pairing.attribution(),
        ):
            check_unchanged(player, pairing.adversary.info.sha256)
            recorded[label] = record(pairing, here, seed, PartOfAll(progress, before, total))
        before += here
        steps = len(recorded[label].game)
        count = f"{len(recorded)} of {len(opponents.names)} opponents"
        progress.note(f"{count}: {label}, {here} games, {steps:,} steps")
    return recorded


def _baseline_of(env: str, runs: Sequence[RunConfig], options: SharedOptions) -> str:
    files = [*(file for config in runs for file in config.plugins), *options.get("plugin_files", ())]
    plugins = options.get("plugins") or plugins_with(files)
    name = plugins.game(env).baseline_adversary
    if name is None:
        raise ConfigError(f"game {env} has no baseline adversary of its own: name one with --baseline")
    return name


def _attacked(runs: Sequence[RunConfig]) -> str:
    """The victim that all runs attack; the game's where there are none."""
    victims = sorted({config.victim for config in runs})
    if len(victims) > 1:
        raise ConfigError(f"runs attack different victims ({', '.join(victims)}): say whose with --victim")
    return victims[0] if victims else "auto"


def _check_pinned(runs: Sequence[RunConfig], victim: Player) -> None:
    """Weights may have changed since the runs attacked them."""
    for config in runs:
        if config.victim_sha256 not in ("", victim.sha256):
            raise VictimError(
                f"{victim.name} has changed since a run began: SHA-256 {victim.sha256}, expected "
                f"{config.victim_sha256}; put the old one back, or name another with --victim"
            )

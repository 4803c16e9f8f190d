"""The opponents a victim plays while its activations are recorded, normal play first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from apil_core.api.config import RunConfig
from apil_core.common.errors import ConfigError, VictimError
from apil_core.evaluation.crossplay.document import Player
from apil_core.evaluation.crossplay.players import (
    Names,
    Participants,
    check_unchanged,
    in_game_of,
    load_all,
    run_config,
)
from apil_core.evaluation.options import PairingOptions
from apil_core.evaluation.pairing import load_pairing
from apil_core.evaluation.progress import PartOfAll, Progress
from apil_core.plugins.default_victim import default_baseline
from apil_core.plugins.registry import plugins_with
from apil_core.studies.activations.recording import Recorded, check_has_activations, record

BASELINE = "baseline"
"""Label of normal play."""


@dataclass(frozen=True)
class Opponents:
    """The victim and its opponents, loaded once and checked.

    Attributes:
        names: runs or policy names by label, normal play first.
        victim: name of the analysed policy.
        participants: the loaded policies.
    """

    names: Names
    victim: str
    participants: Participants


def gather(opponents: Names, victim: str | None, baseline: str | None, options: PairingOptions) -> Opponents:
    """Resolve and load the players; see :func:`apil_core.studies.activations.analysis.analyze`.

    Raises:
        ApilError: a policy does not fit, the runs attack different victims, or the victim is a black box.
    """
    runs = [config for name in opponents.values() if (config := run_config(name)) is not None]
    options = in_game_of(runs, options)
    if options.env is None:
        raise ConfigError("say which game they play: --env GAME")
    if BASELINE in opponents and baseline is not None:
        raise ConfigError(f"{BASELINE!r} is the label of normal play: name its opponent once")
    normal = opponents.get(BASELINE) or baseline or _baseline_of(options.env, options)
    names: dict[str, Path | str] = {BASELINE: normal}
    names |= {label: name for label, name in opponents.items() if label != BASELINE}
    attacked = victim or _attacked(runs)
    participants = load_all(names, {"victim": attacked}, options, look=check_has_activations)
    if victim is None:
        _check_pinned(runs, participants.victims[0])
    return Opponents(names, attacked, participants)


def record_all(opponents: Opponents, games: int, progress: Progress) -> dict[str, Recorded]:
    """Record the victim's activations in ``games`` games against each; normal play has twice as many.

    Args:
        opponents: the victim and its opponents.
        games: against each.
        progress: gets the number of games played, over all opponents.
    """
    participants = opponents.participants
    total = games * (len(opponents.names) + 1)
    recorded: dict[str, Recorded] = {}
    before = 0
    for (label, name), player in zip(opponents.names.items(), participants.adversaries, strict=True):
        here = 2 * games if label == BASELINE else games
        with (
            load_pairing(name, participants.options, victim=opponents.victim) as pairing,
            pairing.attribution(),
        ):
            check_unchanged(player, pairing.adversary.info.sha256)
            recorded[label] = record(
                pairing, here, participants.options.seed, PartOfAll(progress, before, total)
            )
        before += here
        steps = len(recorded[label].game)
        count = f"{len(recorded)} of {len(opponents.names)} opponents"
        progress.note(f"{count}: {label}, {here} games, {steps:,} steps")
    return recorded


def _baseline_of(env: str, options: PairingOptions) -> str:
    plugins = options.plugins or plugins_with(options.plugin_files)
    name = default_baseline(plugins.game(env), plugins)
    if not name:
        raise ConfigError(f"game {env} has no baseline adversary of its own: name one with --baseline")
    return name


def _attacked(runs: Sequence[RunConfig]) -> str:
    """The victim that all runs attack; the game's default where there are none."""
    victims = sorted({config.victim for config in runs})
    if len(victims) > 1:
        raise ConfigError(f"runs attack different victims ({', '.join(victims)}): say whose with --victim")
    return victims[0] if victims else "auto"


def _check_pinned(runs: Sequence[RunConfig], victim: Player) -> None:
    """Check that the weights are the ones the runs attacked."""
    for config in runs:
        if config.victim_sha256 not in ("", victim.sha256):
            raise VictimError(
                f"{victim.name} has changed since a run began: SHA-256 {victim.sha256}, expected "
                f"{config.victim_sha256}; put the old one back, or name another with --victim"
            )

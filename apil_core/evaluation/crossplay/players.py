"""Loading all players before the first game, and checking that all fit and play the same game."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apil_core.api.config import RunConfig
from apil_core.common.errors import ConfigError, RunDirError
from apil_core.evaluation.crossplay.document import Player
from apil_core.evaluation.options import PairingOptions
from apil_core.evaluation.pairing import Pairing, load_pairing
from apil_core.evaluation.results import MatchSetup, PolicyId, in_words
from apil_core.training.export.run_policy import RunCheckpoint, run_path

Names = Mapping[str, Path | str]
"""Players by label."""


@dataclass
class Participants:
    """All players, loaded once.

    Attributes:
        adversaries, victims: in the order given.
        options: for loading any of their pairings, except the victim.
        setting: of the first adversary's games; all others play in the same one.
    """

    adversaries: list[Player]
    victims: list[Player]
    options: PairingOptions
    setting: MatchSetup


def load_all(
    adversaries: Names,
    victims: Names,
    options: PairingOptions,
    look: Callable[[Pairing], object] | None = None,
) -> Participants:
    """Load every player once, without playing.

    The runs among the adversaries determine the game; other policies play in the first one's.

    Args:
        adversaries, victims: runs or policy names by label.
        options: of all pairings; with ``num_envs``.
        look: called with every loaded pairing, which has one game.

    Raises:
        ApilError: a player cannot be loaded or does not fit, or two runs would play in different games
            (physics, options, action modes, seat).
    """
    for side, names in (("adversary", adversaries), ("victim", victims)):
        if not names:
            raise ConfigError(f"name at least one {side}")
    trained = {label: run_config(name) for label, name in adversaries.items()}
    runs = [config for config in trained.values() if config is not None]
    options = in_game_of(runs, options)
    first, opponent = next(iter(adversaries.values())), str(next(iter(victims.values())))

    def load(adversary: Path | str, victim: str) -> MatchSetup:
        with load_pairing(adversary, options, num_envs=1, victim=victim) as pairing:
            if look is not None:
                look(pairing)
            return MatchSetup(**{**pairing.setup(options.seed), "num_envs": options.num_envs})

    met = [(label, load(name, opponent)) for label, name in adversaries.items()]
    setting = met[0][1]
    _check_same_game(met)
    attacked = [setting.victim] + [load(first, str(name)).victim for name in list(victims.values())[1:]]
    return Participants(
        adversaries=[_player(label, each.adversary, trained[label]) for label, each in met],
        victims=[
            _player(label, found, run_config(name))
            for (label, name), found in zip(victims.items(), attacked, strict=True)
        ],
        options=options,
        setting=setting,
    )


def in_game_of(runs: Sequence[RunConfig], options: PairingOptions) -> PairingOptions:
    """``options`` with the game of the first of these runs, and the plugins of all of them.

    A game of a run's one-file plugin must be registered for its opponents as well.
    """
    env = options.env or next((config.env for config in runs), None)
    like = options.like or next((config for config in runs if config.env == env), None)
    files = dict.fromkeys([*(file for config in runs for file in config.plugins), *options.plugin_files])
    return PairingOptions.of(options, env=env, like=like, plugin_files=tuple(files))


def check_unchanged(player: Player, sha256: str) -> None:
    """Check that a player has not changed: a run may continue training meanwhile.

    Raises:
        RunDirError: it has changed.
    """
    if player.sha256 != sha256:
        raise RunDirError(
            f"{player.label} has changed since it was checked: {player.name} was SHA-256 {player.sha256}, "
            f"now is {sha256}; let its run finish, or name one of its checkpoints"
        )


def settings(each: MatchSetup, episodes: int) -> dict[str, Any]:
    """Settings that the games of two given players depend on."""
    return {
        "episodes": episodes,
        "seed": each.seed,
        "num_envs": each.num_envs,
        "mujoco": each.versions.get("mujoco"),
        **_game(each),
    }


def _game(each: MatchSetup) -> dict[str, Any]:
    played = each.options_played
    physics = {"physics": each.physics} if each.physics else {}
    return {
        **physics,  # first, as it is more informative than its values
        "adversary_actions": each.adversary_actions,
        "victim_actions": each.victim_actions,
        "adversary_side": each.adversary_side,
        **({"observers": ", ".join(in_words(each.observers))} if each.observers else {}),
        **{f"game.{key}": value for key, value in played.items() if key != "physics"},
    }


def _check_same_game(met: Sequence[tuple[str, MatchSetup]]) -> None:
    (first, base), rest = met[0], met[1:]
    for label, each in rest:
        here, there = _game(base), _game(each)
        for key in dict.fromkeys([*here, *there]):
            if here.get(key) != there.get(key):
                advice = "leave one out" if key == "observers" else f"say which with {_flag(key)}"
                raise ConfigError(
                    f"players would not play in the same game: {first} has {key} {here.get(key)}, {label} "
                    f"has {there.get(key)}; {advice}"
                )


def _flag(key: str) -> str:
    return f"--set {key}=…" if "." in key else f"--{key.replace('_', '-')}"


def run_config(name: Path | str) -> RunConfig | None:
    """The configuration of the run behind a name, or ``None`` for other policies."""
    path = run_path(name)
    if path is None or not (path.suffix == ".pt" or (path / "config.yaml").is_file()):
        return None
    return RunCheckpoint.find(path).run_dir.config()


def _player(label: str, found: PolicyId, config: RunConfig | None) -> Player:
    method, seed = (None, None) if config is None else (config.method, config.seed)
    return Player(label=label, name=found.name, sha256=found.sha256, method=method, seed=seed)

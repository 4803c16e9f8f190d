"""Players lined up before the first game: all load, all fit the game, and all would play the same one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from apil_core.api.config import ActionMode, RunConfig
from apil_core.api.profiles import Profile
from apil_core.common.errors import ConfigError, RunDirError
from apil_core.evaluation.crossplay.document import Player
from apil_core.evaluation.pairing import Pairing, circumstances, load_pairing
from apil_core.evaluation.results import Circumstances, PolicyId, in_words
from apil_core.plugins.discovery import PluginRegistry
from apil_core.training.export.run_policy import Source, run_path

Names = Mapping[str, Path | str]
"""Players by label."""


class SharedOptions(TypedDict, total=False):
    """Keywords of :func:`apil_core.evaluation.pairing.load_pairing` that hold for all pairings alike."""

    env: str | None
    adversary_actions: ActionMode | None
    victim_actions: ActionMode | None
    game_options: Mapping[str, Any] | None
    sets: Sequence[str]
    physics: Profile | None
    threads: int
    device: str
    plugins: PluginRegistry | None
    plugin_files: Sequence[str]
    trust: bool


@dataclass
class Lineup:
    """Everybody who plays.

    Attributes:
        env: the game.
        adversaries, victims: in the order asked for.
        options: keywords that load any of their pairings, the victim's aside.
        setting: of the first adversary's games; all others play in the same one.
    """

    env: str
    adversaries: list[Player]
    victims: list[Player]
    options: SharedOptions
    setting: Circumstances


def line_up(
    adversaries: Names,
    victims: Names,
    *,
    seed: int,
    num_envs: int,
    options: SharedOptions,
    look: Callable[[Pairing], object] | None = None,
) -> Lineup:
    """Load every player once and play nothing.

    Args:
        adversaries, victims: runs or policy names by label.
        seed, num_envs: of the games to come.
        options: as of :func:`apil_core.evaluation.pairing.load_pairing`; they hold for all pairings.
        look: shown every pairing that is loaded, with one game in it.

    Raises:
        ApilError: somebody cannot be loaded or does not fit, or two adversaries would play in other games
            (physics, options, action modes, seat) than each other.
    """
    for side, names in (("adversary", adversaries), ("victim", victims)):
        if not names:
            raise ConfigError(f"name at least one {side}")
    trained = {label: run_config(name) for label, name in adversaries.items()}
    env = options.get("env") or next((config.env for config in trained.values() if config), None)
    # a game of a run's one-file plugin must be known to the policies it meets as well
    files = [file for config in trained.values() if config for file in config.plugins]
    merged = list(dict.fromkeys([*files, *options.get("plugin_files", ())]))
    options = {**options, "env": env, "plugin_files": merged}
    first, opponent = next(iter(adversaries.values())), str(next(iter(victims.values())))
    met: list[tuple[str, Circumstances]] = []

    def load(adversary: Path | str, victim: str) -> Circumstances:
        with load_pairing(adversary, num_envs=1, seed=seed, victim=victim, **options) as pairing:
            if look is not None:
                look(pairing)
            return Circumstances(**{**circumstances(pairing, seed), "num_envs": num_envs})

    for label, name in adversaries.items():
        met.append((label, load(name, opponent)))
    setting = met[0][1]
    _check_same_game(met)
    attacked = [setting.victim] + [load(first, str(name)).victim for name in list(victims.values())[1:]]
    return Lineup(
        env=setting.env,
        adversaries=[_player(label, each.adversary, trained[label]) for label, each in met],
        victims=[
            _player(label, found, run_config(name))
            for (label, name), found in zip(victims.items(), attacked, strict=True)
        ],
        options=options,
        setting=setting,
    )


def check_unchanged(player: Player, sha256: str) -> None:
    """Whether a player is still who it was: a run may go on training meanwhile.

    Raises:
        RunDirError: it is not.
    """
    if player.sha256 != sha256:
        raise RunDirError(
            f"{player.label} has changed since it was checked: {player.name} was SHA-256 {player.sha256}, "
            f"now is {sha256}; let its run finish, or name one of its checkpoints"
        )


def settings(each: Circumstances, episodes: int) -> dict[str, Any]:
    """What the games of two given players depend on."""
    return {
        "episodes": episodes,
        "seed": each.seed,
        "num_envs": each.num_envs,
        "mujoco": each.versions.get("mujoco"),
        **_game(each),
    }


def _game(each: Circumstances) -> dict[str, Any]:
    played = each.options_played
    physics = {"physics": each.physics} if each.physics else {}
    return {
        **physics,  # first, as it says more than the values behind it
        "adversary_actions": each.adversary_actions,
        "victim_actions": each.victim_actions,
        "adversary_side": each.adversary_side,
        **({"observers": ", ".join(in_words(each.observers))} if each.observers else {}),
        **{f"game.{key}": value for key, value in played.items() if key != "physics"},
    }


def _check_same_game(met: Sequence[tuple[str, Circumstances]]) -> None:
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
    return Source.find(path).run_dir.config()


def _player(label: str, found: PolicyId, config: RunConfig | None) -> Player:
    method, seed = (None, None) if config is None else (config.method, config.seed)
    return Player(label=label, name=found.name, sha256=found.sha256, method=method, seed=seed)

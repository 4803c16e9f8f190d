"""What the outcome of games depends on, apart from the games themselves; stored with every score."""

from __future__ import annotations

from importlib import metadata
from typing import Any

from pydantic import BaseModel

from apil_core.config import ActionMode
from apil_core.observer_options import observers_played
from apil_core.pairing import Pairing
from apil_core.policy import PolicyInfo

_PACKAGES = ("apil", "mujoco", "torch", "numpy")


class PolicyId(BaseModel):
    """Who played."""

    name: str
    sha256: str

    @classmethod
    def of(cls, info: PolicyInfo) -> PolicyId:
        """The part of a policy's identity that is stored."""
        return cls(name=info.name, sha256=info.sha256)


class Circumstances(BaseModel):
    """Who played what against whom, and how: base of everything that reports played games."""

    env: str
    adversary: PolicyId
    victim: PolicyId
    adversary_side: str
    victim_side: str
    adversary_actions: ActionMode
    victim_actions: ActionMode
    seed: int
    num_envs: int
    trained_steps: int | None = None
    game_options: dict[str, Any]
    game_settings: dict[str, Any] = {}
    """What the options came to where a physics profile filled them in; scores from before have none."""
    observers: dict[str, dict[str, Any]] | None = None
    """What was switched on beside the method, with its options; ``None`` in scores from before they told."""
    versions: dict[str, str]

    @property
    def physics(self) -> str | None:
        """Name of the physics profile, ``"custom"`` for values of neither; ``None`` for a game without."""
        return self.game_settings.get("physics")

    @property
    def options_played(self) -> dict[str, Any]:
        """The game's options with the values that a physics profile filled in."""
        given = {key: value for key, value in self.game_options.items() if value is not None}
        return {**self.game_settings, **{k: v for k, v in given.items() if k not in self.game_settings}}


def circumstances(pairing: Pairing, seed: int) -> dict[str, Any]:
    """The fields of :class:`Circumstances` for games of that pairing."""
    config, sides = pairing.config, pairing.game.layout.sides
    return {
        "env": config.env,
        "adversary": PolicyId.of(pairing.adversary.info),
        "victim": PolicyId.of(pairing.victim.info),
        "adversary_side": sides[pairing.side].name,
        "victim_side": sides[1 - pairing.side].name,
        "adversary_actions": config.evaluation.adversary_actions,
        "victim_actions": config.evaluation.victim_actions,
        "seed": seed,
        "num_envs": pairing.game.num_envs,
        "trained_steps": pairing.steps,
        "game_options": config.game,
        "game_settings": pairing.game.settings,
        "observers": observers_played(config),
        "versions": {name: metadata.version(name) for name in (*_PACKAGES, *pairing.game.packages)},
    }

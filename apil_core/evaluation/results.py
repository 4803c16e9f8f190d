"""Scores of played games: rates with intervals, and the settings the games depended on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel

from apil_core.api.config import ActionMode, BlindMode, RunConfig
from apil_core.common.documents import EXACT
from apil_core.common.statistics import Difference, difference, wilson_interval

if TYPE_CHECKING:
    from apil_core.api.policy import PolicyInfo
    from apil_core.config.observers import Observers

_Score = TypeVar("_Score", bound="MatchSetup")


class PolicyId(BaseModel):
    """One player."""

    name: str
    sha256: str

    @classmethod
    def of(cls, info: PolicyInfo) -> PolicyId:
        """The part of a policy's identity that is stored."""
        return cls(name=info.name, sha256=info.sha256)


class MatchSetup(BaseModel):
    """Players, game and settings: base of everything that reports played games."""

    model_config = EXACT

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
    """Options with the physics profile's values filled in; older scores have none."""
    observers: dict[str, dict[str, Any]] | None = None
    """Observers that were switched on, with their options; ``None`` in scores from before this field."""
    white_box: bool = False
    """The adversary's method saw inside the victim."""
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


class Rate(BaseModel):
    """A share of games with its Wilson 95 % interval, as fractions."""

    value: float
    low: float
    high: float


class EvaluationResult(MatchSetup):
    """A score and all it depends on. ``wins`` etc. are the adversary's."""

    episodes: int
    wins: int
    ties: int
    losses: int
    win_rate: Rate
    tie_rate: Rate
    loss_rate: Rate
    win_or_tie_rate: Rate
    causes: dict[str, int]
    mean_length: float
    blind: BlindMode | None = None
    blind_imitator: bool = False
    blind_victim: BlindMode | None = None
    wall_seconds: float


def gap(score: EvaluationResult, base: EvaluationResult, *, ties: bool) -> Difference:
    """Share of games won (with ``ties``: or tied) minus that of ``base``, with Newcombe's 95 % interval."""
    counts = [each.wins + ties * each.ties for each in (score, base)]
    return difference(counts[0], score.episodes, counts[1], base.episodes)


def wilson(count: int, total: int) -> Rate:
    """Share ``count / total`` with the Wilson score interval at 95 %."""
    low, high = wilson_interval(count, total)
    return Rate(value=count / total, low=float(low), high=float(high))


def with_observers_played(score: _Score, config: RunConfig) -> _Score:
    """``score`` of a run, with its observers filled in if it is from before scores stored them."""
    known = score.observers is not None
    return score if known else score.model_copy(update={"observers": observers_played(config)})


def in_words(observers: Observers) -> list[str]:
    """One string per observer, e.g. ``masked_observation (way=mean, share=0.5)``."""
    return [
        f"{name} ({', '.join(f'{key}={value}' for key, value in options.items())})" if options else name
        for name, options in observers.items()
    ]


def observers_played(config: RunConfig) -> dict[str, dict[str, Any]]:
    """The observers of a configuration, each with its options."""
    return {name: config.options.get(name, {}) for name in config.observers}

"""The file ``matrix.yaml`` as a typed model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from apil_core.api.config import ActionMode, BlindMode, PPOConfig, Section
from apil_core.api.profiles import Profile
from apil_core.common.numbers import number_list, whole_number
from apil_core.config.layers import named_text, shipped_names, texts_in

MATRIX_VERSION = 2
"""Raised when a matrix of this version could be misread by older code."""

NAMES_WITHOUT_BUDGET = 2
"""First version in which a cell's name does not hold the matrix's first budget, so that it can be raised."""

BASELINE = "baseline"
"""Label of a game's own opponent of the victim."""

PLAIN, BLINDED = "plain", "blinded"
"""Scores from which tables 1 and 2 are made."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def check_name(name: str, where: str) -> None:
    """Check that a score's name, or an adversary's label, can be a file name.

    Raises:
        ValueError: it cannot.
    """
    if not _NAME.fullmatch(name):
        raise ValueError(f"{where}: a name is made of letters, digits and . _ -")


def _one_or_more(value: Any) -> Any:
    return value if isinstance(value, (list, tuple)) else (value,)


def _steps(value: Any) -> Any:
    return tuple(whole_number(v) if isinstance(v, str) else v for v in _one_or_more(value))


def _seeds(value: Any) -> Any:
    return tuple(number_list(value)) if isinstance(value, str) else _one_or_more(value)


Names = Annotated[tuple[str, ...], BeforeValidator(_one_or_more)]


class ScoreConfig(Section):
    """Games played after training, to score the adversary."""

    episodes: Annotated[int, Field(gt=0)] = 1000
    """Games; 1000 give ± 3 points at 50 %."""
    physics: Profile | None = None
    """Physics profile to play in; null: the one it was trained in."""
    blind: BlindMode | None = None
    """Hide the opponent from the adversary: zeros, or the mean of starting states."""
    observers: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Observers switched on besides the runs' own, such as defences of the victim, each with its options."""
    adversary_actions: ActionMode | None = None
    """Draw the adversary's actions, or take the mode; null: as its run's evaluation."""
    victim_actions: ActionMode | None = None
    """Draw the victim's actions, or take the mode; null: as the run's evaluation."""
    games: Names = ()
    """Only in these games; empty: in all."""


class RetrainingStage(Section):
    """Victims hardened against each method's adversary (tables 3 and 4)."""

    steps: Annotated[int, Field(gt=0)] = 10_000_000
    """Environment steps of each retraining."""
    games: Names = ()
    """Only in these games; empty: in all."""
    methods: Names = ()
    """Only against the adversaries of these methods; empty: of all."""
    adversary_share: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of games (or steps) against the new adversary; the rest is against the baseline one."""
    mix: Literal["per_episode", "per_step"] = "per_episode"
    """Draw the opponent for each game, or for each step."""
    freeze: Literal["none", "value"] = "none"
    """Train the whole victim, or leave its value function as it is."""
    num_envs: Annotated[int, Field(gt=0, le=2**20)] = 128
    """Games stepped together; not the cells'."""
    ppo: PPOConfig = PPOConfig()
    """Learner of the victim; not the cells' (docs/retraining.md)."""
    critic_warmup: Annotated[int, Field(ge=0)] | None = None
    """First iterations that train the critic alone; null: 10 for a new one, else 1."""


class CrossPlayStage(Section):
    """Every adversary of a game against its victim and every retrained one."""

    episodes: Annotated[int, Field(gt=0)] = 1000
    """Games of each pairing."""
    physics: Profile | None = None
    """Physics profile to play in; null: the one of the runs."""
    games: Names = ()
    """Only in these games; empty: in all."""


class ActivationStage(Section):
    """The victim's activations against each opponent: t-SNE, and density under normal play."""

    episodes: Annotated[int, Field(gt=1)] = 40
    """Games against each opponent."""
    games: Names = ()
    """Only in these games; empty: in all."""


class SnapshotStage(Section):
    """A strip of pictures of one game per adversary, a won one if there is any."""

    pictures: Annotated[int, Field(ge=2, le=12)] = 6
    """Pictures in a strip."""
    games: Names = ()
    """Only in these games; empty: in all."""


class Matrix(Section):
    """A benchmark: every combination of methods, games, seeds, victims, budgets and axes is one cell."""

    version: int = MATRIX_VERSION
    """Version of this schema."""
    title: str = ""
    """Headline of the report."""
    methods: Annotated[Names, Field(min_length=1)]
    """Attack methods; `apil methods` lists them."""
    games: Annotated[Names, Field(min_length=1)]
    """Games; `apil games` lists them."""
    seeds: Annotated[tuple[int, ...], BeforeValidator(_seeds), Field(min_length=1)] = (0,)
    """Seeds, as a list or as 0..4."""
    steps: Annotated[tuple[int, ...], BeforeValidator(_steps), Field(min_length=1)] = (35_000_000,)
    """Budgets, environment steps of training; 1M and 300k are fine."""
    victims: dict[str, Annotated[Names, Field(min_length=1)]] = Field(default_factory=dict)
    """Policies under attack by game; a game that is not named has its own default victim."""
    presets: Names = ()
    """Ready-made settings of runs, e.g. paper; `config` lies over them."""
    game_presets: dict[str, Names] = Field(default_factory=dict)
    """Further ones of a game's runs, by game; they lie over `presets`."""
    config: dict[str, Any] = Field(default_factory=dict)
    """Settings of all runs, as in a run's own config file; paths start at the matrix's file."""
    axes: dict[str, Annotated[tuple[Any, ...], Field(min_length=1)]] = Field(default_factory=dict)
    """Further axes: a setting as --set names it, and its values."""
    scores: dict[str, ScoreConfig] = Field(default_factory=lambda: {PLAIN: ScoreConfig()})
    """Games played after training, by name; tables are made of `plain` and `blinded`."""
    adversaries: dict[str, dict[str, str]] = Field(default_factory=dict)
    """Adversaries that were trained elsewhere, by game: label and policy, scored like the methods' own."""
    baseline: bool = True
    """Score each game's own opponent of the victim likewise, where it has one."""
    retraining: RetrainingStage | None = None
    crossplay: CrossPlayStage | None = None
    activations: ActivationStage | None = None
    snapshots: SnapshotStage | None = None

    @field_validator("scores", mode="before")
    @classmethod
    def _sections(cls, value: Any) -> Any:
        """Fill an empty section, ``plain:``, with its defaults."""
        if isinstance(value, Mapping):
            return {name: {} if section is None else section for name, section in value.items()}
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Matrix:
        axes: dict[str, tuple[Any, ...]] = {
            "methods": self.methods,
            "games": self.games,
            "seeds": self.seeds,
            "steps": self.steps,
            **{f"victims.{game}": names for game, names in self.victims.items()},
            **{f"axes.{key}": values for key, values in self.axes.items()},
        }
        for key, values in axes.items():
            if len({repr(value) for value in values}) < len(values):
                raise ValueError(f"{key} names a value twice")
        for section in ("axes", "config"):
            for key in _OWN_AXES.keys() & getattr(self, section).keys():
                raise ValueError(f"{section}.{key}: use {_OWN_AXES[key]!r} for it")
        if min(self.steps) <= 0 or min(self.seeds) < 0:
            raise ValueError("steps must be positive, seeds must not be negative")
        if PLAIN not in self.scores:
            raise ValueError(f"scores needs {PLAIN!r}: table 1 is made of it")
        if self.scores[PLAIN].blind or self.scores[PLAIN].observers:
            raise ValueError(f"scores.{PLAIN}: table 1 is made of it; give blind or observers another score")
        for name in self.scores:
            check_name(name, f"scores.{name}")
        for game, named in self.adversaries.items():
            for label in named:
                check_name(label, f"adversaries.{game}.{label}")
                if label in (BASELINE, *self.methods):
                    raise ValueError(
                        f"adversaries.{game}.{label}: that is a method's or the game's own; rename"
                    )
        self._check_games()
        self._check_game_axes()
        return self

    def _check_game_axes(self) -> None:
        """Reject axes over game options: it would be ambiguous which players meet in which variant.

        Options of observers count too, since they change observations.
        """
        watched = tuple(f"options.{name}." for name in texts_in(self.config.get("observers")))
        games = [key for key in self.axes if key.startswith(("game.", *watched)) or key == "observers"]
        for stage in ("crossplay", "activations"):
            if games and stage in self.stages:
                raise ValueError(f"{stage} needs one game for all its players: leave out axes.{games[0]}")

    def _check_games(self) -> None:
        named = {
            "victims": tuple(self.victims),
            "adversaries": tuple(self.adversaries),
            "game_presets": tuple(self.game_presets),
            **{f"scores.{name}.games": score.games for name, score in self.scores.items()},
            **{f"{stage}.games": value.games for stage, value in self.stages.items()},
        }
        for key, games in named.items():
            for game in games:
                if game not in self.games:
                    known = ", ".join(self.games)
                    raise ValueError(f"{key}: {game!r} is not among the matrix's games ({known})")
        if self.retraining is not None:
            for method in self.retraining.methods:
                if method not in self.methods:
                    raise ValueError(f"retraining.methods: {method!r} is not among the matrix's methods")

    @property
    def stages(self) -> dict[str, RetrainingStage | CrossPlayStage | ActivationStage | SnapshotStage]:
        """The stages that follow training, by name."""
        stages = {
            "retraining": self.retraining,
            "crossplay": self.crossplay,
            "activations": self.activations,
            "snapshots": self.snapshots,
        }
        return {name: stage for name, stage in stages.items() if stage is not None}

    def scores_of(self, game: str) -> dict[str, ScoreConfig]:
        """The scores that are played in a game."""
        return {name: score for name, score in self.scores.items() if not score.games or game in score.games}

    def has(self, stage: str, game: str) -> bool:
        """Return whether a stage is enabled for a game."""
        found = self.stages.get(stage)
        return found is not None and (not found.games or game in found.games)


_OWN_AXES = {
    "method": "methods",
    "env": "games",
    "seed": "seeds",
    "steps": "steps",
    "victim": "victims",
}


def matrix_names() -> list[str]:
    """Names of the matrices that ship with the package."""
    return shipped_names(__package__, "matrices")


def _beside(folder: Path, named: Any) -> Any:
    """Policies' names; made absolute where they name something that lies in that folder."""
    if isinstance(named, Mapping):
        return {label: _beside(folder, policy) for label, policy in named.items()}
    if isinstance(named, list):
        return [_beside(folder, policy) for policy in named]
    scheme, colon, rest = named.rpartition(":") if isinstance(named, str) else ("", "", "")
    found = folder / rest
    return f"{scheme}{colon}{found.absolute()}" if rest and found.exists() else named


def load_matrix(name: str) -> Matrix:
    """Load the matrix in a file, or the shipped one of that name.

    Raises:
        ConfigError: it cannot be read or is wrong, one line per mistake with file and line.
    """

    from apil_core.common.trust import named_in
    from apil_core.config.layers import from_folder, parse_yaml
    from apil_core.config.problems import Problem, raise_problems, validated

    text, origin = named_text(name, __package__, "matrices", "matrix")
    data, lines = parse_yaml(text, origin)
    if isinstance(data.get("config"), dict) and origin == str(Path(name)):
        data["config"] = from_folder(Path(name).parent, data["config"])
    for section in data.keys() & {"victims", "adversaries"}:
        data[section] = _beside(Path(name).parent, data[section])
    named_in(Path(name), data)
    origins = {key: f"{origin}:{line}" for key, line in lines.items()} | {(): origin}
    version = data.get("version")
    if isinstance(version, int) and version > MATRIX_VERSION:
        reason = f"is {version}, newer than this apil understands ({MATRIX_VERSION}): upgrade apil"
        raise_problems([Problem(("version",), reason)], origins)
    return validated(Matrix, data, origins)

"""Options of a pairing and of its score: the one model from which keywords and flags are made."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, InstanceOf, ValidationError, model_validator

from apil_core.api.config import ActionMode, BlindMode, RunConfig, Section
from apil_core.api.profiles import Profile
from apil_core.common.errors import ConfigError
from apil_core.config.problems import Problem, problems_of
from apil_core.plugins.defined import as_text
from apil_core.plugins.discovery import PluginRegistry


class OptionSet(Section):
    """Options that functions take as keywords; each mistake becomes one line.

    Raises:
        ConfigError: one line per mistake.
    """

    def __init__(self, **options: Any):
        try:
            super().__init__(**options)
        except ValidationError as error:
            items = {tuple(item["loc"]): dict(item) for item in error.errors()}
            problems = problems_of(error, type(self))
            raise ConfigError("\n".join(_line(items[each.key], each) for each in problems)) from error

    @classmethod
    def of(cls, options: Section | None = None, **changes: Any) -> Self:
        """``options`` updated by ``changes``, restricted to the fields of this model."""
        known = set() if options is None else options.model_fields_set & cls.model_fields.keys()
        stated = {key: getattr(options, key) for key in known}
        return cls(**{**stated, **changes})


def _line(item: dict[str, Any], problem: Problem) -> str:
    key = ".".join(map(str, problem.key))
    for kind, bound, words in (("greater", "ge", "at least"), ("less", "le", "at most")):
        if item["type"] == f"{kind}_than_equal":
            return f"{key} must be {words} {item['ctx'][bound]:g}, got {item['input']}"
    return f"{key}: {problem.reason}" if key else problem.reason


class PairingOptions(OptionSet):
    """Options for loading two players and their game."""

    env: str | None = None
    """Game; needed unless ADVERSARY is a run [default: the run's]."""
    victim: Annotated[str | None, BeforeValidator(as_text)] = None
    """Policy it plays against, named like ADVERSARY [default: the run's victim, else the game's]."""
    victim_seat: Literal[0, 1] | None = None
    """Side of the victim, where the adversary is no run [default: the game's]."""
    physics: Profile | None = None
    """Physics profile; faithful: the game as it was made, fast: cheaper and nearly the same game
    [default: the run's, else faithful]."""
    adversary_actions: ActionMode | None = None
    """Draw actions, or take the mode [default: as configured]."""
    victim_actions: ActionMode | None = None
    """Draw actions, or take the mode [default: as configured]."""
    game_options: dict[str, Any] = Field(default_factory=dict)
    """Options of the game to change."""
    observers: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Observer to switch on besides the run's, such as a defence of the victim; repeatable."""
    sets: tuple[str, ...] = ()
    """One option of the game (game.KEY) or of an --observer (options.NAME.KEY); repeatable."""
    checkpoint_path: Path | None = None
    """Checkpoint of the run to take, or best [default: the newest]."""
    plugin_files: tuple[str, ...] = ()
    """One-file plugin to load; repeatable."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the games and of all draws."""
    num_envs: Annotated[int, Field(ge=1)] | None = None
    """Games in parallel; a seed's games depend on it [default: up to 128]."""
    threads: Annotated[int, Field(ge=0)] = 0
    """Physics threads; 0: all CPUs. Never changes results."""
    device: str = "cpu"
    """Device of the networks: cpu, cuda or cuda:N."""
    trust: bool = False
    """Allow players whose loading runs code, e.g. python:...; in Python: the command line has --trust."""
    like: InstanceOf[RunConfig] | None = None
    """Run whose game, victim and settings apply to an adversary that no run trained."""
    plugins: InstanceOf[PluginRegistry] | None = None
    """Registry to use [default: installed plugins, and the one-file plugins of the runs]."""


class RenderOptions(OptionSet):
    """Options of a video, contact sheet or window."""

    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of everything random."""
    episodes: Annotated[int, Field(ge=1)] | None = None
    """Games to show, or with --until to try at most [default: 1 or 100]."""
    until: Literal["win", "tie", "loss"] | None = None
    """Show only the first game that ends like this for the adversary."""
    video: Path | None = None
    """Write a video, FILE.mp4."""
    snapshots: Annotated[int, Field(ge=1, le=50)] | None = None
    """Write a contact sheet: so many pictures of each game."""
    contact_sheet: Path | None = None
    """File of the contact sheet [default: snapshots.png]."""
    width: Annotated[int, Field(ge=1, le=4096)] | None = None
    """Pixels of a frame [default: 960], of a snapshot [480]."""
    height: Annotated[int, Field(ge=1, le=4096)] | None = None
    """Pixels of a frame [default: 540], of a snapshot [320]."""
    speed: Annotated[float, Field(ge=0.001, le=1000)] = 1.0
    """1: real time, 0.25: slow motion."""
    fps: Annotated[float, Field(ge=1, le=1000)] = 30.0
    """About so many frames a second."""

    @model_validator(mode="after")
    def _file_has_pictures(self) -> Self:
        if self.contact_sheet is not None and self.snapshots is None:
            raise ValueError("--out names the file of --snapshots N, which is missing")
        return self

    @property
    def sheet(self) -> Path:
        """File of the contact sheet."""
        return self.contact_sheet or Path("snapshots.png")

    @property
    def games(self) -> int:
        """Number of games shown."""
        return 1 if self.until else self.episodes or 1

    def size(self, default: tuple[int, int]) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.width or default[0], self.height or default[1]


class FidelityOptions(OptionSet):
    """Options for comparing games with their published scores."""

    physics: Profile | None = None
    """Physics profile to play everything in; games without profiles are skipped [default: faithful]."""
    episodes: Annotated[int, Field(ge=1)] = 1000
    """Games per row; 1000 give ± 3 points at 50 %."""
    switches: bool = False
    """Also play every single switch: action modes, game options."""
    switch_episodes: Annotated[int, Field(ge=1)] = 300
    """Games per switch and per variant."""
    variants: tuple[dict[str, Any], ...] = ()
    """Also play this combination of adversary_actions, victim_actions and game options, wherever a game has
    them; repeatable."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the games and of all draws."""
    num_envs: Annotated[int, Field(ge=1)] = 128
    """Games in parallel at most; a seed's games depend on it."""
    threads: Annotated[int, Field(ge=0)] = 0
    """Physics threads; 0: all CPUs. Never changes results."""
    plugin_files: tuple[str, ...] = ()
    """One-file plugin to load; repeatable."""


class EvaluationOptions(PairingOptions):
    """Options for scoring an adversary."""

    episodes: Annotated[int, Field(ge=1)] = 1000
    """Games to play; 1000 give ± 3 points at 50 %."""
    blind: BlindMode | None = None
    """Hide the opponent from the adversary: zeros, or the mean of starting states."""
    blind_imitator: bool = False
    """Hide it from the adversary's methods too, with --blind."""
    blind_victim: BlindMode | None = None
    """Hide the adversary from the victim: remaining wins do not depend on what it sees."""

    @model_validator(mode="after")
    def _imitator_needs_a_mode(self) -> Self:
        if self.blind_imitator and self.blind is None:
            raise ValueError("--blind-imitator needs --blind zeros or --blind initial")
        return self

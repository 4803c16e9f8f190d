"""Flags shared by several verbs; their help is the config model's own text and defaults."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from apil_core.api.config import RunConfig
from apil_core.api.profiles import Profile
from apil_core.config.layers import located, preset_names

if TYPE_CHECKING:
    from apil_core.config.layers import Layer
    from apil_core.evaluation.pairing import PairingOptions
    from apil_core.plugins.discovery import PluginRegistry

_SETTINGS = Group("What to train", sort_key=0)
_SOURCES = Group("Where settings come from (defaults < presets < file < flags < --set)", sort_key=1)

_REST = Group("Output", sort_key=3)

PHYSICS_HELP = "faithful: the game as it was made, fast: cheaper and nearly the same game"

Json = Annotated[
    bool,
    Parameter(
        name="--json",
        show_default=False,
        group=_REST,
        help="Print the result as JSON on stdout, and nothing else there.",
    ),
]
Show = Annotated[
    bool,
    Parameter(
        show_default=False,
        group=_REST,
        help="In the end also draw the learning curve (curve.png) and film a won game (won-game.mp4).",
    ),
]
Quiet = Annotated[bool, Parameter(show_default=False, group=_REST, help="No progress display.")]
Plugins = Annotated[
    list[Path],
    Parameter(name="--plugin", show_default=False, help="One-file plugin to load; repeatable."),
]


def setting(name: str, **options: Any) -> Parameter:
    """A flag that sets one config key: its help is the key's description and true default."""
    info = RunConfig.model_fields[name]
    default = "" if info.default in (None, ()) else f" [default: {info.default}]"
    return Parameter(help=f"{info.description}{default}", group=_SETTINGS, show_default=False, **options)


def _source(text: str, **options: Any) -> Parameter:
    return Parameter(help=text, group=_SOURCES, show_default=False, **options)


@Parameter(name="*")
@dataclass
class ConfigFlags:
    """Everything that makes up a run's configuration."""

    method: Annotated[str | None, setting("method", alias="-m")] = None
    env: Annotated[str | None, setting("env", alias="-e")] = None
    victim: Annotated[str | None, setting("victim")] = None
    steps: Annotated[int | None, setting("steps")] = None
    num_envs: Annotated[int | None, setting("num_envs")] = None
    threads: Annotated[int | None, setting("threads")] = None
    seed: Annotated[int | None, setting("seed")] = None
    physics: Annotated[
        Profile | None,
        Parameter(
            group=_SETTINGS, show_default=False, help=f"Physics profile; {PHYSICS_HELP} [default: faithful]."
        ),
    ] = None
    device: Annotated[str | None, setting("device")] = None
    init_from: Annotated[str | None, setting("init_from")] = None
    preset: Annotated[
        list[str],
        _source(f"Ready-made settings: {', '.join(preset_names())}; repeatable.", metavar="NAME"),
    ] = field(default_factory=list)
    config: Annotated[Path | None, _source("YAML file, or a run directory to copy the settings of.")] = None
    set: Annotated[
        list[str],
        _source("One setting, e.g. options.apil.prediction=oracle; repeatable.", metavar="KEY=VALUE"),
    ] = field(default_factory=list)
    plugin: Annotated[list[Path], _source("One-file plugin to load; repeatable.")] = field(
        default_factory=list
    )

    def layers(self) -> list[Layer]:
        """The configuration layers these flags stand for."""
        from apil_core.config.resolve import gather, plugin_files

        keys = ("method", "env", "victim", "steps", "num_envs", "threads", "seed", "device")
        flags: dict[str, Any] = {key: getattr(self, key) for key in keys}
        flags["game.physics"] = self.physics
        if self.init_from is not None:
            flags["init_from"] = located(self.init_from, Path())
        if self.plugin:  # besides what files name, not instead of it
            below = plugin_files(gather(self.config, self.preset, self.set))
            flags["plugins"] = [*below, *(str(path.absolute()) for path in self.plugin)]
        return gather(self.config, self.preset, self.set, flags)

    def resolve(self) -> tuple[RunConfig, PluginRegistry]:
        """The checked configuration, and the plugins it was checked against.

        Raises:
            ApilError: one line per mistake.
        """
        from apil_core.config.resolve import plugin_files, resolve_layers
        from apil_core.plugins.discovery import discover

        layers = self.layers()
        plugins = discover(plugin_files(layers))
        return resolve_layers(layers, plugins), plugins


_Actions = Annotated[
    Literal["sample", "mode"] | None,
    Parameter(help="Draw actions, or take the mode [default: as configured]."),
]


@Parameter(name="*")
@dataclass
class PairingFlags:
    """Who plays whom, and in which game."""

    env: Annotated[
        str | None, Parameter(alias="-e", help="Game; needed unless ADVERSARY is a run [default: the run's].")
    ] = None
    victim: Annotated[
        str | None,
        Parameter(help="Whom it plays, named likewise [default: the run's victim, else the game's]."),
    ] = None
    physics: Annotated[
        Profile | None,
        Parameter(help=f"Physics profile; {PHYSICS_HELP} [default: the run's, else faithful]."),
    ] = None
    adversary_actions: _Actions = None
    victim_actions: _Actions = None
    sets: Annotated[
        list[str],
        Parameter(
            name="--set",
            show_default=False,
            metavar="KEY=VALUE",
            help="One option of the game (game.KEY) or of an --observer (options.NAME.KEY); repeatable.",
        ),
    ] = field(default_factory=list)
    observer: Annotated[
        list[str],
        Parameter(
            show_default=False,
            metavar="NAME",
            help="Observer to switch on besides the run's, such as a defence of the victim; repeatable.",
        ),
    ] = field(default_factory=list)
    checkpoint: Annotated[
        Path | None, Parameter(help="Checkpoint of the run to take, or best [default: the newest].")
    ] = None
    plugin: Plugins = field(default_factory=list)

    def options(self) -> PairingOptions:
        """As keywords of :func:`apil_core.evaluation.pairing.load_pairing`."""
        return {
            "env": self.env,
            "victim": self.victim,
            "adversary_actions": self.adversary_actions,
            "victim_actions": self.victim_actions,
            "observers": {name: {} for name in self.observer},
            "sets": self.sets,
            "physics": self.physics,
            "checkpoint_path": self.checkpoint,
            "plugin_files": [str(path) for path in self.plugin],
        }

"""Expand a matrix into cells: every combination, resolved to the configuration of one run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import PurePosixPath
from typing import Any

from apil_core.api.config import RunConfig
from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.numbers import short_number
from apil_core.config.layers import Layer, flag_layer, preset_layer, set_layer, texts_in
from apil_core.config.observers import with_observers
from apil_core.config.resolve import plugin_files, resolve_layers
from apil_core.evaluation.results import observers_played
from apil_core.plugins.default_victim import default_baseline
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.studies.bench.matrix import BASELINE, NAMES_WITHOUT_BUDGET, Matrix, ScoreConfig

_UNSAFE = re.compile(r"[^A-Za-z0-9_.=,+-]+")


@dataclass(frozen=True)
class Cell:
    """One run of a benchmark.

    Attributes:
        game, method, seed, steps, victim: its values on the axes of every matrix.
        axes: the matrix's further axes that apply to it, value by key.
        name: its directory below ``cells/``.
        config: of the run; the victim is named, "auto" no more.
    """

    game: str
    method: str
    seed: int
    steps: int
    victim: str
    axes: Mapping[str, Any] = field(compare=False)
    name: str
    config: RunConfig = field(compare=False, repr=False)


@dataclass(frozen=True)
class Benchmark:
    """A resolved matrix: every name in it exists and fits.

    Attributes:
        matrix: with the victims of every game named.
        cells: in the order they are run.
        baselines: name of each game's own opponent of the victim; games without one are left out.
        hashes: SHA-256 of the matrix's adversaries, by policy's name, where they have been loaded.
        plugins: it was resolved against.
    """

    matrix: Matrix
    cells: tuple[Cell, ...]
    baselines: Mapping[str, str]
    plugins: PluginRegistry
    hashes: Mapping[str, str] = field(default_factory=dict)

    def adversaries(self, game: str) -> dict[str, str]:
        """Label → policy of the adversaries that are not trained: the game's own, and those of the matrix."""
        own = {BASELINE: self.baselines[game]} if game in self.baselines else {}
        return {**own, **self.matrix.adversaries.get(game, {})}

    def cells_of(self, game: str) -> list[Cell]:
        """Return the cells of one game."""
        return [cell for cell in self.cells if cell.game == game]


def resolve_matrix(matrix: Matrix, origin: str = "matrix") -> Benchmark:
    """Expand a matrix and check every cell as ``apil run`` would.

    Args:
        matrix: to expand.
        origin: its name in messages.

    Raises:
        ApilError: one line per mistake; nothing has been started then.
    """
    base = {game: _base_layers(matrix, game, origin) for game in matrix.games}
    plugins = discover(plugin_files(base[matrix.games[0]]))  # presets name none
    _check_names(matrix, origin, plugins)
    _check_used(matrix, origin, plugins)
    cells = tuple(_expand(matrix, origin, base, plugins))
    twice = {cell.name for cell in cells if sum(other.name == cell.name for other in cells) > 1}
    if twice:
        raise ConfigError(
            f"{origin}: two cells would be called {min(twice)}; values of an axis look too alike"
        )
    victims = {game: tuple(dict.fromkeys(c.victim for c in cells if c.game == game)) for game in matrix.games}
    scores = {name: _spelt_out(name, score, origin, cells, plugins) for name, score in matrix.scores.items()}
    resolved = matrix.model_copy(update={"victims": victims, "scores": scores}, deep=True)
    baselines = {game: default_baseline(plugins.game(game), plugins) for game in matrix.games}
    return Benchmark(resolved, cells, {game: name for game, name in baselines.items() if name}, plugins)


def _spelt_out(
    name: str, score: ScoreConfig, origin: str, cells: Sequence[Cell], plugins: PluginRegistry
) -> ScoreConfig:
    """Return the score with all observer options set; every cell must be able to switch the observers on."""
    played: dict[str, Any] = {}
    for cell in cells if score.observers else ():
        try:
            config = with_observers(cell.config, plugins, score.observers)
        except ApilError as error:
            raise ConfigError(f"{origin}: scores.{name}: {error}") from error
        played = {observer: observers_played(config)[observer] for observer in score.observers}
    return score.model_copy(update={"observers": played})


def _base_layers(matrix: Matrix, game: str, origin: str) -> list[Layer]:
    presets = (*matrix.presets, *matrix.game_presets.get(game, ()))
    own = Layer(dict(matrix.config), dict.fromkeys(_paths(matrix.config), f"{origin}: config"), preset=True)
    return [*map(preset_layer, presets), own]


def _paths(data: Mapping[str, Any], prefix: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for key, value in data.items():
        yield (*prefix, key)
        if isinstance(value, Mapping):
            yield from _paths(value, (*prefix, key))


def _check_names(matrix: Matrix, origin: str, plugins: PluginRegistry) -> None:
    from apil_core.config.problems import Problem, raise_problems, unknown_name

    known_methods, known_games = list(plugins.methods), plugins.game_names()
    problems: list[Problem] = [
        unknown_name(("methods", i), "method", name, known_methods)
        for i, name in enumerate(matrix.methods)
        if name not in known_methods
    ]
    problems += [
        unknown_name(("games", i), "game", name, known_games)
        for i, name in enumerate(matrix.games)
        if not plugins.has_game(name)
    ]
    raise_problems(problems, {problem.key: origin for problem in problems})


def _check_used(matrix: Matrix, origin: str, plugins: PluginRegistry) -> None:
    """Reject method options that no cell uses: they are probably a mistake."""
    named = [
        *texts_in(matrix.config.get("observers")),
        *(n for v in matrix.axes.get("observers", ()) for n in texts_in(v)),
    ]
    used = {spec.name for method in matrix.methods for spec in plugins.run_plugins(method, named)}
    written = [("config.options", name) for name in _section(matrix.config.get("options"))]
    written += [(f"axes.{key}", owner) for key in matrix.axes if (owner := _owner(key)) is not None]
    for where, name in written:
        if name not in used:
            known = ", ".join(sorted(used))
            raise ConfigError(
                f"{origin}: {where}: no method or observer here reads options of {name!r} (but of {known})"
            )


def _section(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _owner(key: str) -> str | None:
    """Return the method or observer whose option an axis is, or ``None``."""
    parts = key.split(".")
    return parts[1] if parts[0] == "options" and len(parts) > 2 else None


def _expand(
    matrix: Matrix, origin: str, base: Mapping[str, list[Layer]], plugins: PluginRegistry
) -> Iterator[Cell]:
    resolved: dict[str, RunConfig] = {}  # cells that differ in seed and budget only are checked once
    combinations = {method: _combinations(matrix, method, plugins) for method in matrix.methods}
    several_victims = {game for game, names in matrix.victims.items() if len(names) > 1}
    for seed, method, game in product(matrix.seeds, matrix.methods, matrix.games):
        victims = matrix.victims.get(game, ("auto",))
        for victim, steps, chosen in product(victims, matrix.steps, combinations[method]):
            named = victim if game in several_victims else None
            further = steps != matrix.steps[0] or matrix.version < NAMES_WITHOUT_BUDGET
            name = _name(game, method, seed, steps if further else None, named, chosen)
            kind = repr((game, method, victim, chosen))
            if kind not in resolved:
                flags = {"method": method, "env": game, "seed": seed, "steps": steps, "victim": victim}
                resolved[kind] = _config(base[game], flags, chosen, plugins, f"{origin}, cell {name}")
            config = resolved[kind].model_copy(update={"seed": seed, "steps": steps}, deep=True)
            yield Cell(game, method, seed, steps, config.victim, chosen, name, config)


def _combinations(matrix: Matrix, method: str, plugins: PluginRegistry) -> list[dict[str, Any]]:
    """Unique combinations of the further axes' values; options of absent plugins are left out."""
    found: dict[str, dict[str, Any]] = {}
    for values in product(*matrix.axes.values()):
        chosen = dict(zip(matrix.axes, values, strict=True))
        observers = texts_in(chosen.get("observers", matrix.config.get("observers")))
        parts = {spec.name for spec in plugins.run_plugins(method, observers)}
        applying = {key: value for key, value in chosen.items() if _owner(key) in (None, *parts)}
        found.setdefault(repr(applying), applying)
    return list(found.values())


def _config(
    base: list[Layer], flags: dict[str, Any], axes: Mapping[str, Any], plugins: PluginRegistry, where: str
) -> RunConfig:
    layers = [*base, flag_layer(flags), *(_axis_layer(key, value) for key, value in axes.items())]
    try:
        return resolve_layers(layers, plugins)
    except ApilError as error:
        first, *others = str(error).splitlines()
        raise ConfigError("\n".join([f"{where}: {first}", *others])) from error


def _axis_layer(key: str, value: Any) -> Layer:
    layer = set_layer(f"{key}=null")  # for its checks of the key
    data: Any = layer.data
    *path, last = key.split(".")
    for part in path:
        data = data[part]
    data[last] = value
    return Layer(layer.data, {tuple(key.split(".")): f"axis {key}={value}"}, command_line=True)


def _name(
    game: str, method: str, seed: int, steps: int | None, victim: str | None, axes: Mapping[str, Any]
) -> str:
    """Readable directory name, independent of the axes' other values, so that a matrix can be extended.

    Of several budgets the first is not named, so that it can be raised.
    """
    parts = [f"s{seed}", *([short_number(steps)] if steps else []), *([victim] if victim else [])]
    parts += [f"{key.removeprefix('options.')}={value}" for key, value in axes.items()]
    words = [_UNSAFE.sub("_", str(part)) for part in parts]
    return str(PurePosixPath(_UNSAFE.sub("_", game)) / method / "-".join(words))

"""``check_game``: check a game against the whole contract of ``apil_core.Game``."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from apil_core.api.game import Game
from apil_core.api.specs import GameSpec, load
from apil_core.common.errors import UnknownNameError
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import make_game
from apil_core.testing.checks import checking
from apil_core.testing.game_checks import CHECKS
from apil_core.testing.game_play import Play, Trial
from apil_core.testing.method_spec import check_import, check_options
from apil_core.testing.registry import registry_of
from apil_core.testing.reports import GameReport

SHORT = 20
"""Steps of a game where it has an option ``max_steps`` and the caller did not set it: some must end."""

TIMED_STEPS = 50


def check_game(
    game: GameSpec | str,
    *,
    plugins: Sequence[str | Path] = (),
    options: Mapping[str, Any] | None = None,
) -> GameReport:
    """Run every check of :class:`apil_core.Game` on a game, with random players.

    docs/testing.md lists the checks and shows a failure.

    Args:
        game: a spec, or the name of an installed game or one that ``plugins`` offer; of a family with target.
        plugins: files of one-file plugins.
        options: of the game; an option ``max_steps`` is set to 20 unless it is among them.

    Returns:
        the checks made, and the game's speed; ``print`` it.

    Raises:
        ContractError: the first check that fails.
        UnknownNameError: no game has that name.
    """
    begin = time.process_time()
    name = game if isinstance(game, str) else game.name
    trial = Trial(name)
    with trial.check("spec", UnknownNameError):
        registry = registry_of(trial, game, plugins)
        trial.make = maker(registry, name, options)
    check_spec(trial, registry)
    for check in CHECKS.values():
        check(trial)
    return _report(trial, begin)


def maker(
    registry: PluginRegistry, name: str, options: Mapping[str, Any] | None = None
) -> Callable[[int, int], Game]:
    """What makes a registered game, shortened where possible."""
    chosen = dict(options or {})
    model = registry.game(name).config
    if "max_steps" not in chosen and model is not None and "max_steps" in load(model).model_fields:
        chosen["max_steps"] = SHORT
    return lambda num_envs, threads: make_game(
        name, num_envs=num_envs, threads=threads, options=chosen, plugins=registry
    )


@checking("spec")
def check_spec(trial: Trial, registry: PluginRegistry) -> None:
    """Check the spec without playing."""
    spec = registry.game(trial.name)
    trial.need(spec.victim_side in (0, 1), f"victim_side must be 0 or 1, got {spec.victim_side}")
    check_options(trial, spec.config)
    made = trial.make(1, 1)
    trial.need(isinstance(made, Game), f"{spec.factory} must give an apil_core.Game, got {made!r}")
    made.close()
    sides = tuple(side.name for side in made.layout.sides)
    text = f"sides of the spec are {', '.join(spec.sides)}, those of the game {', '.join(sides)}"
    trial.need(spec.target or sides == tuple(spec.sides), text)
    check_import(trial, registry, "games", trial.name.partition(":")[0])


def _report(trial: Trial, begin: float) -> GameReport:
    with trial.game() as game:
        play, start = Play(game), time.perf_counter()
        play.run(TIMED_STEPS)
        seconds = time.perf_counter() - start
        sides = [(s.name, s.observation_size, s.action_size) for s in game.layout.sides]
        speed = TIMED_STEPS * game.num_envs / seconds
    return GameReport(
        name=trial.name,
        checked=trial.checked(),
        skipped=trial.skipped,
        sides=sides,
        steps_per_second=speed,
        endings=trial.endings,
        seconds=time.process_time() - begin,
    )

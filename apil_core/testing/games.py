"""``check_game``: check a game against the whole contract of ``apil_core.Game``."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from apil_core.api.game import Game
from apil_core.api.specs import GameSpec, load
from apil_core.common.errors import UnknownNameError
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import make_game
from apil_core.testing.checks import GAME_CHECKS, ContractError, reported_as
from apil_core.testing.game_checks import CHECKS
from apil_core.testing.game_play import Play, Trial
from apil_core.testing.method_spec import check_import, check_options
from apil_core.testing.method_under_test import raise_if_broken, registry_with
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
    name = game.name if isinstance(game, GameSpec) else game
    registry = registry_with(f"game {name!r}", GAME_CHECKS["spec"], plugins)
    if isinstance(game, GameSpec):
        registry.games[name] = game
    elif not registry.has_game(name):
        raise_if_broken(f"game {name!r}", GAME_CHECKS["spec"], registry, name)
        raise UnknownNameError("game", name, registry.game_names())
    skipped = check_spec(registry, name, options)
    trial = trial_of(registry, name, options)
    trial.skipped += skipped
    for check in CHECKS.values():
        with reported_as(f"game {name!r}", GAME_CHECKS[check.__name__]):
            check(trial)
    return _report(trial, begin)


def trial_of(registry: PluginRegistry, name: str, options: Mapping[str, Any] | None = None) -> Trial:
    """Make the trial of a registered game, shortened where possible."""
    chosen = dict(options or {})
    model = registry.game(name).config
    if "max_steps" not in chosen and model is not None and "max_steps" in load(model).model_fields:
        chosen["max_steps"] = SHORT

    def make(num_envs: int, threads: int) -> Game:
        return make_game(name, num_envs=num_envs, threads=threads, options=chosen, plugins=registry)

    return Trial(name, make)


def check_spec(registry: PluginRegistry, name: str, options: Mapping[str, Any] | None) -> list[str]:
    """Check the spec without playing; return what could not be checked."""
    who, check, spec = f"game {name!r}", GAME_CHECKS["spec"], registry.game(name)
    if spec.victim_side not in (0, 1):
        raise ContractError(who, check, f"victim_side must be 0 or 1, got {spec.victim_side}")
    check_options(who, check, spec.config)
    with reported_as(who, check):
        made = trial_of(registry, name, options).make(1, 1)
    try:
        if not isinstance(made, Game):
            raise ContractError(who, check, f"{spec.factory} must give an apil_core.Game, got {made!r}")
        sides = tuple(side.name for side in made.layout.sides)
    finally:
        close = getattr(made, "close", None)
        if close is not None:
            close()
    if not spec.target and sides != tuple(spec.sides):
        text = f"sides of the spec are {', '.join(spec.sides)}, those of the game {', '.join(sides)}"
        raise ContractError(who, check, text)
    reason = check_import(who, check, registry, "games", name.partition(":")[0])
    return [] if reason is None else [reason]


def _report(trial: Trial, begin: float) -> GameReport:
    with trial.game() as game:
        play, start = Play(game), time.perf_counter()
        play.run(TIMED_STEPS)
        seconds = time.perf_counter() - start
        sides = [(s.name, s.observation_size, s.action_size) for s in game.layout.sides]
        speed = TIMED_STEPS * game.num_envs / seconds
    titles = [check.title for check in GAME_CHECKS.values()]
    left_out = {text.split(":")[0].capitalize() for text in trial.skipped}
    return GameReport(
        name=trial.name,
        checked=[title for title in titles if title not in left_out],
        skipped=trial.skipped,
        sides=sides,
        steps_per_second=speed,
        endings=trial.endings,
        seconds=time.process_time() - begin,
    )

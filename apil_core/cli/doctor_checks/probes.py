"""What :mod:`.trial` runs in a process of its own; answers are one JSON object on stdout.

python -m apil_core.cli.doctor_checks.probes '["play", [], ["sumo-ants", "1.5"]]'
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from apil_core.api.game import Game
from apil_core.api.specs import load
from apil_core.common.errors import ApilError
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.plugins.registry import load_policy, make_game

GAMES = 64
"""Games that are stepped together; enough for the threads of most machines."""

WARM_UP = 40
"""Steps before the clock starts at most: contacts, which cost most, come when robots have fallen."""

PICTURE = 64, 48


def libraries(plugins: PluginRegistry) -> dict[str, Any]:
    """Import what training needs; what torch says of threads and GPUs."""
    begin = time.perf_counter()
    import apil_core.training.trainer  # noqa: F401  (the whole learner with it)

    seconds = time.perf_counter() - begin
    import torch

    gpus = range(torch.cuda.device_count()) if torch.cuda.is_available() else ()
    return {
        "seconds": seconds,
        "torch": torch.__version__,
        "threads": torch.get_num_threads(),
        "gpus": [torch.cuda.get_device_name(index) for index in gpus],
    }


def play(plugins: PluginRegistry, name: str, seconds: str) -> dict[str, Any]:
    """Step games with random actions for about that time, at least once.

    Returns:
        ``rate`` in environment steps per second, ``games`` stepped together, and whether it uses ``mujoco``.
    """
    game = make_game(name, num_envs=GAMES, threads=0, plugins=plugins)
    try:
        return {"rate": _rate(game, float(seconds)), "games": GAMES, "mujoco": "mujoco" in sys.modules}
    finally:
        game.close()


def _rate(game: Game, seconds: float) -> float:
    rng = np.random.default_rng(0)
    game.seed(0)
    game.reset()

    def run(steps: float) -> float:
        """Steps per second over that many steps, or as many as fit into the time."""
        begin, done = time.perf_counter(), 0
        while done == 0 or (done < steps and time.perf_counter() - begin < seconds):
            step = game.step(_actions(game, rng))
            game.reset(step.done)
            done += 1
        return done * game.num_envs / (time.perf_counter() - begin)

    if seconds > 0:
        run(WARM_UP)
    return run(np.inf)


def _actions(game: Game, rng: np.random.Generator) -> tuple[Any, Any]:
    first, second = (
        rng.uniform(side.action_low, side.action_high, (game.num_envs, side.action_size)).astype(np.float32)
        for side in game.layout.sides
    )
    return first, second


def picture(plugins: PluginRegistry, name: str) -> dict[str, Any]:
    """Draw the beginning of a game; ``shades`` counts different values in the picture."""
    game = make_game(name, num_envs=1, plugins=plugins)
    try:
        game.seed(0)
        game.reset()
        pixels = game.render(0, *PICTURE, ((0, 0, 255), (255, 0, 0)))
        return {"shape": list(pixels.shape), "shades": len(np.unique(pixels))}
    finally:
        game.close()


def victims(plugins: PluginRegistry) -> dict[str, Any]:
    """Load every policy that is listed as being here, and the one that ``auto`` means in each game.

    Returns:
        ``listed``: by name, ``None`` where weights are not here, ``""`` where they load, else the reason;
        ``auto``: by game, the victim's name and the reason why it does not load or ``""``.
    """
    from apil_core.api.config import RunConfig
    from apil_core.policies.seats import victim_name

    listed: dict[str, str | None] = {}
    for scheme, policies in plugins.policies.items():
        try:
            rows = load(policies.lister)() if policies.lister else []
        except Exception as error:
            listed[f"{scheme}:"] = _reason(error)
        else:
            listed |= {row.name: _why_not(row.name, plugins) if row.available else None for row in rows}
    auto = {}
    for game in plugins.games.values():
        if not game.family and game.default_victim:
            name = victim_name(RunConfig(env=game.name), plugins)
            auto[game.name] = {"name": name, "error": _why_not(name, plugins)}
    return {"listed": listed, "auto": auto}


def _why_not(name: str, plugins: PluginRegistry) -> str:
    try:
        load_policy(name, plugins=plugins)
    except Exception as error:  # a foreign loader may raise anything
        return _reason(error)
    return ""


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split()) or "no message"
    return text if isinstance(error, ApilError) else f"{type(error).__name__}: {text}"


PROBES: dict[str, Callable[..., dict[str, Any]]] = {
    probe.__name__: probe for probe in (libraries, play, picture, victims)
}


def main() -> None:
    """Run the probe named on the command line."""
    name, plugin_files, arguments = json.loads(sys.argv[1])
    try:
        answer = PROBES[name](discover(plugin_files, forgiving=True), *arguments)
    except Exception as error:  # foreign code may raise anything
        answer = {"error": _reason(error)}
    print(f"\n{json.dumps(answer)}", flush=True)


if __name__ == "__main__":
    main()

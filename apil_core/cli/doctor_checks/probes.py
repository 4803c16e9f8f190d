"""Probes that run in a process of their own, so that a crash cannot affect the others.

python -m apil_core.cli.doctor_checks.probes '["play", [], ["sumo-ants", "1.5"]]' prints a JSON object.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.common.errors import failures

if TYPE_CHECKING:
    from apil_core.plugins.discovery import PluginRegistry

PATIENCE = 120.0
"""Time limit of a probe, s; a busy machine needs some of it to import torch."""

GAMES = 64
"""Games that are stepped together; enough for the threads of most machines."""

WARM_UP = 40
"""Steps before the clock starts at most: contacts, which cost most, come when robots have fallen."""

Answer = dict[str, Any]


class TrialError(Exception):
    """A probe failed; the message is one line."""


def attempt(
    probe: str,
    *arguments: str,
    plugin_files: Sequence[Path] = (),
    environment: Mapping[str, str] | None = None,
    patience: float = PATIENCE,
) -> Answer:
    """Run the probe of that name in a subprocess and return its result.

    Args:
        probe: one of :data:`PROBES`.
        arguments: handed to it after the plugins.
        plugin_files: one-file plugins to load first.
        environment: variables to set in its process.
        patience: seconds it may take.

    Raises:
        TrialError: it raised, took too long, or its process died.
    """
    order = json.dumps([probe, [str(path) for path in plugin_files], arguments])
    # -P: like the console script, it must not import modules from the user's folder
    command = [sys.executable, "-P", "-m", "apil_core.cli.doctor_checks.probes", order]
    try:
        done = subprocess.run(
            command,
            env={**os.environ, **(environment or {})},
            capture_output=True,
            text=True,
            errors="replace",
            timeout=patience,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        raise TrialError(f"no answer within {patience:.0f} s") from None
    try:
        answer = json.loads(_last_line(done.stdout))  # others may print too
    except ValueError:
        answer = None
    if not isinstance(answer, dict):
        raise TrialError(_end(done.returncode, done.stderr))
    if "error" in answer:
        raise TrialError(answer["error"])
    return answer


def _last_line(text: str) -> str:
    return text.strip().rpartition("\n")[2]


def _end(code: int, stderr: str) -> str:
    if code >= 0:
        return f"its process ended with exit code {code}: {_last_line(stderr) or 'no message'}"
    known = {number.value: number.name for number in signal.Signals}
    return f"its process was ended by {known.get(-code, f'signal {-code}')}"


def libraries(plugins: PluginRegistry) -> Answer:
    """Import training's dependencies; return what torch reports about threads and GPUs."""
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


def play(plugins: PluginRegistry, name: str, seconds: str) -> Answer:
    """Step ``games`` together with random actions for about that time, at least once: ``rate``, steps/s."""
    import numpy as np

    from apil_core.plugins.registry import make_game

    game = make_game(name, num_envs=GAMES, threads=0, plugins=plugins)
    rng, limit = np.random.default_rng(0), float(seconds)

    def rate(steps: float) -> float:
        """Measure steps/s over that many steps, or as many as fit into the time."""
        begin, done = time.perf_counter(), 0
        while done == 0 or (done < steps and time.perf_counter() - begin < limit):
            first, second = (
                rng.uniform(-side.action_limit, side.action_limit, (GAMES, side.action_size)).astype(
                    np.float32
                )
                for side in game.layout.sides
            )
            game.reset(game.step((first, second)).done)
            done += 1
        return done * GAMES / (time.perf_counter() - begin)

    try:
        game.seed(0)
        game.reset()
        if limit > 0:
            rate(WARM_UP)
        return {"rate": rate(np.inf), "games": GAMES}
    finally:
        game.close()


def picture(plugins: PluginRegistry, name: str) -> Answer:
    """Draw the first frames of a game; ``shades`` counts different values in the picture."""
    import numpy as np

    from apil_core.plugins.registry import make_game

    game = make_game(name, num_envs=1, plugins=plugins)
    try:
        game.seed(0)
        game.reset()
        return {"shades": len(np.unique(game.render(0, 64, 48, ((0, 0, 255), (255, 0, 0)))))}
    finally:
        game.close()


def victims(plugins: PluginRegistry) -> Answer:
    """Load every policy listed as available, and the one that ``auto`` means in each game.

    Returns:
        ``listed``: by name, ``None`` where weights are not here, ``""`` where they load, else the reason;
        ``auto``: by game, the victim's name and the reason why it does not load or ``""``.
    """
    from apil_core.api.config import RunConfig
    from apil_core.api.specs import load
    from apil_core.plugins.registry import load_policy
    from apil_core.policies.loading import victim_name

    def why_not(name: str) -> str:
        try:
            load_policy(name, plugins=plugins)
        except failures() as error:  # a foreign loader may raise anything
            return _reason(error)
        return ""

    listed: dict[str, str | None] = {}
    for scheme, policies in plugins.policies.items():
        try:
            rows = load(policies.lister)() if policies.lister else []
        except failures() as error:
            listed[f"{scheme}:"] = _reason(error)
        else:
            listed |= {row.name: why_not(row.name) if row.available else None for row in rows}
    named = [game.name for game in plugins.games.values() if not game.family and game.default_victim]
    autos = {game: victim_name(RunConfig(env=game), plugins) for game in named}
    auto = {game: {"name": name, "error": why_not(name)} for game, name in autos.items()}
    return {"listed": listed, "auto": auto}


def _reason(error: BaseException) -> str:
    from apil_core.common.errors import ApilError

    text = " ".join(str(error).split()) or "no message"
    return text if isinstance(error, ApilError) else f"{type(error).__name__}: {text}"


PROBES: dict[str, Callable[..., Answer]] = {
    probe.__name__: probe for probe in (libraries, play, picture, victims)
}


def main() -> None:
    """Run the probe named on the command line."""
    from apil_core.plugins.discovery import discover

    name, plugin_files, arguments = json.loads(sys.argv[1])
    try:
        answer = PROBES[name](discover(plugin_files, forgiving=True), *arguments)
    except failures() as error:  # foreign code may raise anything
        answer = {"error": _reason(error)}
    print(f"\n{json.dumps(answer)}", flush=True)


if __name__ == "__main__":
    main()

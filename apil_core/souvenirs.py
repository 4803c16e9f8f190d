"""What a finished run can take home: its learning curve as a picture, and a film of a game it won."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pydantic import BaseModel

from apil_core.errors import ApilError
from apil_core.progress import Progress
from apil_core.rundir import RunDir

TRIES = 30
"""Games looked at for one that the adversary wins."""


class Souvenirs(BaseModel):
    """The files made; ``None`` where it could not be done, and then ``notes`` says why."""

    curve: Path | None = None
    won_game: Path | None = None
    notes: list[str] = []


def make_souvenirs(run: RunDir, progress: Progress | None = None) -> Souvenirs:
    """Draw the run's learning curve and film a game that its adversary wins, into its directory.

    Nothing depends on them, so whatever keeps one from being made is a note, not an error.

    Args:
        run: a finished run. Files of the same names are replaced.
        progress: told of every game tried.
    """
    made = Souvenirs()
    made.curve = _attempt(made, "no learning curve", lambda: _draw(run))
    made.won_game = _attempt(made, "no film of a won game", lambda: _film(run, progress or Progress()))
    return made


def _attempt(made: Souvenirs, lack: str, make: Callable[[], Path]) -> Path | None:
    try:
        return make()
    except Exception as error:  # OpenGL, encoder or disk; further seeds may be waiting for their turn
        kind = "" if isinstance(error, ApilError) else f"{type(error).__name__}: "
        made.notes.append(f"{lack}: {kind}{error}")
        return None


def _draw(run: RunDir) -> Path:
    from apil_core.curve_groups import read_groups
    from apil_core.curve_picture import draw_curves

    draw_curves(read_groups([run]), run.curve_path)
    return run.curve_path


def _film(run: RunDir, progress: Progress) -> Path:
    from apil_core.pairing import load_pairing
    from apil_core.show import Programme, show

    config = run.config()
    path = run.won_game_path
    path.unlink(missing_ok=True)
    programme = Programme(config.seed, episodes=TRIES, until="win", video=path)
    programme.check()
    with load_pairing(run.path, num_envs=1, threads=1, seed=config.seed, device=config.device) as pairing:
        show(pairing, programme, progress)
    return path

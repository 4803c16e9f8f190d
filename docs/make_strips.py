"""Makes the contact sheets in ``docs/images/``: one game between pretrained agents each.

    python docs/make_strips.py [GAME ...]

Needs the zoo's weights (docs/victims.md) and OpenGL (docs/watching.md).
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from PIL import Image

from apil_core.evaluation.options import RenderOptions
from apil_core.evaluation.pairing import load_pairing
from apil_core.evaluation.video.recording import show
from apil_core.evaluation.video.single_game import Outcome

HERE = Path(__file__).parent
WIDTH, PANEL = 1600, (480, 320)

GAMES: dict[str, tuple[str, Outcome, int]] = {
    "kick-and-defend": ("zoo:kick-and-defend/defender/v1", "win", 0),
    "you-shall-not-pass": ("zoo:you-shall-not-pass/blocker/v1", "win", 0),
    "sumo-humans": ("zoo:sumo-humans/fighter/v1", "loss", 0),
    "sumo-ants": ("zoo:sumo-ants/fighter/v1", "win", 0),
    "run-to-goal-humans": ("zoo:run-to-goal-humans/runner_1/v1", "win", 0),
    "run-to-goal-ants": ("zoo:run-to-goal-ants/runner_1/v1", "win", 0),
    "toy-pursuit": ("zero", "loss", 0),
}
"""Adversary, the outcome to show, and the seed."""


def make(game: str) -> None:
    adversary, outcome, seed = GAMES[game]
    with tempfile.TemporaryDirectory() as folder:
        sheet = Path(folder) / "sheet.png"
        size = dict(zip(("width", "height"), PANEL, strict=True))
        options = RenderOptions(seed=seed, until=outcome, snapshots=5, contact_sheet=sheet, **size)
        with load_pairing(adversary, num_envs=1, env=game) as pairing:
            (played,) = show(pairing, options).games
        picture = Image.open(sheet).convert("RGB")
    picture = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS)
    path = HERE / "images" / f"strip-{game}.png"
    picture.quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)
    size = path.stat().st_size // 1000
    print(f"{path.name}: game {played.number}, {played.outcome}, {played.cause}, {size} kB", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("games", nargs="*", metavar="GAME", help=", ".join(GAMES))
    for game in parser.parse_args().games or GAMES:
        make(game)


if __name__ == "__main__":
    main()

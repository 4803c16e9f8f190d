"""Makes the contact sheets in ``docs/images/``: one game each of pretrained agents or of a shipped adversary.

    python docs/make_strips.py [PICTURE ...]

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
from apil_core.training.export.embedded import known

HERE = Path(__file__).parent
WIDTH, PANEL = 1600, (480, 320)

PICTURES: dict[str, tuple[str, Outcome, int]] = {
    "strip-kick-and-defend": ("zoo:kick-and-defend/defender/v1", "win", 0),
    "strip-you-shall-not-pass": ("zoo:you-shall-not-pass/blocker/v1", "win", 0),
    "strip-sumo-humans": ("zoo:sumo-humans/fighter/v1", "loss", 0),
    "strip-sumo-ants": ("zoo:sumo-ants/fighter/v1", "win", 0),
    "strip-run-to-goal-humans": ("zoo:run-to-goal-humans/runner_1/v1", "win", 0),
    "strip-run-to-goal-ants": ("zoo:run-to-goal-ants/runner_1/v1", "win", 0),
    "strip-toy-pursuit": ("zero", "loss", 0),
    **{
        f"win-{name.partition('/')[0]}": (f"embedded:{name}", "win", 0)
        for name in known()
        if "/adversary/" in name and not name.startswith("sumo-ants")  # it ties, by leaving the ring
    },
}
"""Adversary, the outcome to show, and the seed, by the picture's name, which ends with the game's."""


def make(picture: str) -> None:
    adversary, outcome, seed = PICTURES[picture]
    game = picture.partition("-")[2]
    with tempfile.TemporaryDirectory() as folder:
        sheet = Path(folder) / "sheet.png"
        size = dict(zip(("width", "height"), PANEL, strict=True))
        options = RenderOptions(seed=seed, until=outcome, snapshots=5, contact_sheet=sheet, **size)
        with load_pairing(adversary, num_envs=1, env=game) as pairing:
            (played,) = show(pairing, options).games
        image = Image.open(sheet).convert("RGB")
    image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    path = HERE / "images" / f"{picture}.png"
    image.quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)
    size = path.stat().st_size // 1000
    print(f"{path.name}: game {played.number}, {played.outcome}, {played.cause}, {size} kB", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("pictures", nargs="*", metavar="PICTURE", help=", ".join(PICTURES))
    for picture in parser.parse_args().pictures or PICTURES:
        make(picture)


if __name__ == "__main__":
    main()

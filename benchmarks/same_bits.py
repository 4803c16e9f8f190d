"""Print a hash of each of a few short trainings, to compare around a change that must not change numbers.

    python benchmarks/same_bits.py /tmp/before > before.txt     # on the old commit
    python benchmarks/same_bits.py /tmp/after > after.txt       # on the new one, on the same machine
    diff before.txt after.txt

Four methods on two games, one run continued, one with the preset `efficient`, one hardened victim and one
student: three iterations each, some minutes in all. Hashes cover every tensor and number of the last
checkpoint; of exported files the size is printed. They depend on the processor.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import torch

GAMES = {"kick-and-defend": ("8", "256"), "toy-pursuit": ("32", "128")}
"""Games stepped together, and steps of each in a rollout."""

QUIET = "--quiet"


def apil(*words: str | Path) -> None:
    """Run the command line in a subprocess, so that no state is left over."""
    command = [Path(sys.executable).with_name("apil"), *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, bytes]]:
    """Every tensor and number in nested dictionaries and lists, by its path; no settings, no times."""
    if isinstance(value, torch.Tensor):
        yield name, value.detach().cpu().contiguous().numpy().tobytes()
    elif isinstance(value, Mapping):
        for key, inner in sorted(value.items(), key=lambda item: str(item[0])):
            if key != "config" and "seconds" not in str(key):
                yield from leaves(inner, f"{name}/{key}")
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from leaves(inner, f"{name}/{index}")
    elif not isinstance(value, str):  # they name directories
        yield name, repr(value).encode()


def report(label: str, folder: Path) -> None:
    """Print one line: the hash of the newest checkpoint in the folder."""
    newest = max(folder.rglob("*.pt"), key=lambda path: path.stat().st_mtime)
    digest = hashlib.sha256()
    for name, data in leaves(torch.load(newest, weights_only=True)):
        digest.update(name.encode() + b"\0" + data)
    print(f"{digest.hexdigest()[:24]}  {label}", flush=True)


def main(root: Path) -> None:
    """Run all trainings in an empty directory and print the hashes."""
    for game, (num_envs, num_steps) in GAMES.items():
        for method in ("adrl", "apl", "apil", "e_apil"):
            out = root / f"{game}-{method}"
            steps = 3 * int(num_envs) * int(num_steps)
            settings = ["--set", f"ppo.num_steps={num_steps}", "--set", "evaluation.episodes=8"]
            settings += ["--num-envs", num_envs, "--steps", str(steps), "--out", str(out), QUIET]
            apil("run", "-m", method, "-e", game, *settings)
            report(f"{game} {method}", out)
    run = root / "toy-pursuit-e_apil"
    apil("resume", run, "--steps", "20000", QUIET)
    report("toy-pursuit e_apil, continued", run)
    efficient = root / "efficient"
    few = ("--steps", "12288", QUIET)
    apil("run", "-m", "e_apil", "-e", "kick-and-defend", "--preset", "efficient", "--out", efficient, *few)
    report("kick-and-defend e_apil, efficient", efficient)
    for kind in ("safetensors", "onnx", "torchscript"):
        file = root / f"adversary.{kind}"
        apil("export", run, "--format", kind, "--out", file)
        print(f"{file.stat().st_size:24}  {kind}", flush=True)
    hardened = root / "hardened"
    apil("retrain", root / "kick-and-defend-adrl", "--episodes", "8", "--out", hardened, *few)
    report("kick-and-defend hardened", hardened)
    student = root / "student"
    side = ("--env", "kick-and-defend", "--role", "kicker", "--num-envs", "32")
    apil("distill", *side, "--episodes", "8", "--out", student, *few)
    report("kick-and-defend student", student)


if __name__ == "__main__":
    main(Path(sys.argv[1]))

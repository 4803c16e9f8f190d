"""Wrong input in bulk: configs, run directories, victim files, command lines and matrices, mutated at random.

    python benchmarks/fuzz.py --scale 0.05            # a twentieth of the cases
    python benchmarks/fuzz.py --only victims:17       # one case again, its output shown

Each case is one ``apil`` command in a forked worker, in a directory of its own. A case is at fault if it
shows a traceback, hangs, ends with exit code 0 though its input is wrong by construction, or changes or
leaves files it does not name. The exit code is 1 if any is.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

COUNTS = {"configs": 800, "runs": 1000, "victims": 1000, "lines": 1000, "matrices": 150}
FAULTS = ("traceback", "hang", "exit 0", "files")
LIMIT = 120.0
"""Seconds until a case hangs; the longest takes 10 on an idle core."""

IMPORTED_ONCE = ("apil_envs", "onnxruntime", "scipy.stats", "torch", "apil_core.runs.dry_run")
TINY = "--method adrl --env toy-pursuit --num-envs 8 --steps 256 --threads 1 --set ppo.num_steps=16"
SETTINGS: dict[str, Any] = {
    **{"method": "apil", "env": "toy-pursuit", "victim": "scripted:toy-pursuit/evader/v1", "steps": 256},
    **{"num_envs": 8, "threads": 1, "seed": 0, "device": "cpu", "game": {"max_steps": 50}},
    "reward": {"dense_weight": 0.1, "anneal_fraction": 0.0, "normalize": True},
    "ppo": {"num_steps": 16, "epochs": 2, "minibatches": 2, "learning_rate": 3e-4, "hidden": [8, 8]},
    "checkpoint": {"every_iterations": 1, "keep": 2},
    "evaluation": {"episodes": 10, "every_steps": 0},
    "options": {"apil": {"prediction": "oracle"}},
}
MATRIX: dict[str, Any] = {
    **{
        "title": "Fuzz",
        "methods": ["adrl", "apl"],
        "games": ["toy-pursuit"],
        "seeds": [0, 1],
        "steps": "256",
    },
    "config": {"num_envs": 8, "ppo": {"num_steps": 16}, "evaluation": {"episodes": 0}},
    "scores": {"plain": {"episodes": 10}, "blinded": {"episodes": 5, "blind": "zeros"}},
    **{"axes": {"ppo.lam": [0.9, 0.95]}, "retraining": {"steps": 256}, "crossplay": {"episodes": 5}},
}
NO_NUMBERS: tuple[Any, ...] = ({"a": 1}, [[], {}], "no number", "1e999x")
WILD: tuple[Any, ...] = (
    *(*NO_NUMBERS, None, "", -1, 0, 1.5, 10**30, float("inf"), float("nan"), [], {}, True, "x" * 300),
    *("\x1b[31mred", "../../..", "[/b]", "a b", "=1+1", "python:os:system", "é", "-", "~", "0..999999999999"),
)
NO_YAML = ("\n\tx: 1\n", "\nx: [1\n", "\n---\nsteps: 1\n", "\nx: &a [*a]\n", "\nx: !!int y\n", "\nx: \0\n")
"""Text that makes any settings file invalid when appended."""
READERS = (
    *("runs list runs", "runs list runs --json", "runs compare runs/r runs/r", "bench report runs/r"),
    *("config show --config runs/r", "config diff runs/r runs/r", "eval runs/r --episodes 4 --quiet"),
    *("resume runs/r --quiet", "export runs/r --format safetensors"),
)
LINES = (
    *(f"run {TINY} --dry-run", f"config show {TINY}", "config validate my.yaml", "config diff my.yaml run"),
    "eval random --env toy-pursuit --episodes 4 --num-envs 4 --seed 1 --blind zeros --quiet",
    "eval run --episodes 4 --quiet --victim-actions mode --checkpoint best --json",
    "crossplay --adversaries run,random --victims auto --episodes 4 --labels a,b --quiet",
    *("runs list run --json", "runs compare run run --json", "methods --json", "games --json"),
    "victims check random --env toy-pursuit --side pursuer --json",
    "bench run my.yaml --dry-run --workers 1 --threads 1 --quiet",
    "bench run smoke --dry-run --executor ray --quiet",
)
WRITERS = (
    *("runs plot run --out curve.png --metric ppo/kl", "play run --until win --video a.mp4 --seed 3"),
    *("new method my-attack", "analyze activations run --games 2", "retrain run --steps 256 --out hard"),
    *("distill --env toy-pursuit --role evader --steps 256 --out d", "run --steps 256 --out r"),
)
"""Commands that may be slow or write files: used only with a mistake."""


@dataclass(frozen=True)
class Case:
    """A command, whether it must fail, and the change to its input."""

    words: list[str]
    wrong: bool
    what: str


def settings(chance: random.Random, base: dict[str, Any], path: Path) -> tuple[bool, str]:
    """Write ``base`` with one change; return whether it is now invalid, and the change."""
    from ruamel.yaml import YAML

    data, wrong, what = altered(chance, base)
    with path.open("w", encoding="utf-8") as file:
        YAML(typ="safe", pure=True).dump(data, file)
    if chance.random() < 0.25:
        wrong, what = True, chance.choice(NO_YAML)
        path.write_bytes(path.read_bytes() + what.encode())
    elif chance.random() < 0.25:
        content, _, what = damaged(chance, path.read_bytes())
        path.write_bytes(content)
        wrong = False
    return wrong, what


def altered(chance: random.Random, data: Any) -> tuple[Any, bool, str]:
    """Nested data with a key put in, left out or given another value."""
    holder = data = copy.deepcopy(data)
    path: list[Any] = []
    while isinstance(holder, dict | list) and holder:
        path.append(chance.choice(list(holder) if isinstance(holder, dict) else range(len(holder))))
        above, holder = holder, holder[path[-1]]
    if not path:
        return data, False, "nothing"
    kind, number = chance.randrange(4), type(holder) in (int, float)
    if kind == 0 and isinstance(above, dict):
        above["no_such_key"] = holder
        return data, True, f"a key beside {path}"
    if kind == 1:
        del above[path[-1]]
        return data, False, f"without {path}"
    above[path[-1]] = value = chance.choice(NO_NUMBERS if kind == 2 and number else WILD)
    return data, kind == 2 and number, f"{path}: {value!r}"


def damaged(chance: random.Random, content: bytes) -> tuple[bytes, bool, str]:
    """Bytes of a file altered; whether nothing in it can be read any more."""
    kind, place = chance.randrange(6), chance.randrange(len(content))
    behind, noise = content[place:], chance.randbytes(16)
    return (
        (content[: place // 2], True, f"cut after {place // 2}"),
        (chance.choice((b"", b"\xff\xfe\0", b"[[[", b"{}", b"\x80\x04.")), True, "another content"),
        (content[:place] + bytes([behind[0] ^ 1 << noise[0] % 8]) + behind[1:], False, f"a bit at {place}"),
        (content[:place] + behind[noise[0] :], False, f"without {noise[0]} bytes at {place}"),
        (content[:place] + noise + behind[16:], False, f"noise at {place}"),
        (content + noise, False, "noise behind"),
    )[kind]


def config_case(chance: random.Random, here: Path) -> Case:
    wrong, what = settings(chance, SETTINGS, here / "my.yaml")
    verb = chance.choice(("config validate", "run --dry-run --config", "config show --config"))
    return Case([*verb.split(), "my.yaml"], wrong, what)


def matrix_case(chance: random.Random, here: Path) -> Case:
    wrong, what = settings(chance, MATRIX, here / "my.yaml")
    return Case(["bench", "run", "my.yaml", "--dry-run", "--quiet"], wrong, what)


def run_case(chance: random.Random, here: Path) -> Case:
    shutil.copytree(here.parent / "seeds" / "run", here / "runs" / "r")
    path = chance.choice([p for p in sorted(here.rglob("*")) if p.is_file() and p.stat().st_size])
    if path.suffix == ".json" and chance.random() < 0.5:
        data, wrong, what = altered(chance, json.loads(path.read_text()))
        path.write_text(json.dumps(data))
    else:
        content, wrong, what = damaged(chance, path.read_bytes())
        path.write_bytes(content)
    words = chance.choice(READERS).split()
    needed = path.name == "iteration-00000002.pt" and words[0] in ("eval", "resume", "export")
    return Case(words, wrong and needed, f"{path.name}: {what}")


def victim_case(chance: random.Random, here: Path) -> Case:
    source, other = (chance.choice(sorted((here.parent / "seeds" / "victims").iterdir())) for _ in range(2))
    content, wrong, what = damaged(chance, source.read_bytes())
    if chance.random() < 0.1:
        content, wrong, what = other.read_bytes(), other != source, f"is {other.name}"
    (here / source.name).write_bytes(content)
    words = f"victims check {source.stem}:{source.name} --env toy-pursuit --side pursuer"
    return Case(words.split(), wrong, what)


def line_case(chance: random.Random, here: Path) -> Case:
    (here / "my.yaml").write_text(json.dumps(SETTINGS))
    (here / "run").symlink_to(here.parent / "seeds" / "run")
    line = chance.choice((*LINES, *WRITERS))
    words, kind = line.split(), chance.randrange(3 if line in WRITERS else 9)
    value = str(
        chance.choice(("", "-1", "x" * 300, "[/b]", "é", "-", "--", "1e999", "~", "../..", "a,b", "0"))
    )
    if kind < 3:
        changed = ([*words, "--no-such-flag"], [*words, "--seed=1.5"], ["no-such-verb", *words[1:]])[kind]
        return Case(changed, True, "a mistake")
    place = chance.randrange(1, len(words))
    if words[place] not in ("--dry-run", "--steps", "--episodes", "4", "256"):  # without them it may be long
        words[place : place + 1] = ([value], [], [words[place]] * 2)[kind % 3]
    return Case(words, False, f"word {place}")


FAMILIES: dict[str, Callable[[random.Random, Path], Case]] = dict(
    zip(COUNTS, (config_case, run_case, victim_case, line_case, matrix_case), strict=True)
)


def make_seeds(root: Path) -> None:
    """A run and a victim file of each format, all valid."""
    import stable_baselines3 as sb3

    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    from policies.foreign_files import Gaussian, save

    from apil_core import OpponentInsideEnv
    from apil_core.cli.guard import guarded

    run, victims = root / "run", root / "victims"
    victims.mkdir(parents=True)
    flags = "--set evaluation.episodes=10 --set checkpoint.every_iterations=1 --quiet"
    code = guarded([*f"run {TINY} {flags}".split(), "--out", str(run)])
    for kind, end in (("onnx", "onnx"), ("torchscript", "pt"), ("safetensors", "safetensors")):
        code += guarded(["export", str(run), "--format", kind, "--out", str(victims / f"{kind}.{end}")])
    save(Gaussian(), victims / "torch-export.pt2")
    model = sb3.PPO("MlpPolicy", OpponentInsideEnv("toy-pursuit"), n_steps=64, device="cpu", seed=0)
    model.save(victims / "sb3.zip")
    sys.exit(code)


def forked(work: Callable[[], Any], out: Path | None) -> int:
    """Fork a worker in its own process group that exits with the result of ``work``; return its id."""
    if child := os.fork():
        return child
    code = 99
    try:
        os.setsid()
        if out is not None:
            file = os.open(out, os.O_WRONLY | os.O_CREAT)
            os.dup2(file, 1)
            os.dup2(file, 2)
        code = int(work() or 0)
        sys.stdout.flush()
    except SystemExit as error:
        code = int(error.code or 0)
    finally:
        os._exit(code)


def snapshot(folder: Path) -> dict[str, str]:
    """Hashes of all files below, locks left out, as their holders may leave them."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ".lock"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def tried(name: str, root: Path, show: bool) -> tuple[bool, list[str]]:
    """Run a case; return whether its command succeeded, and its faults, which are printed."""
    from apil_core.cli.guard import guarded

    family, number = name.split(":")
    here, out = root / f"{family}-{number}", root / f"{family}-{number}.out"
    (here / "tmp").mkdir(parents=True)
    case = FAMILIES[family](random.Random(name), here)
    before = snapshot(here)

    def work() -> int:
        os.chdir(here)
        tempfile.tempdir = os.environ["TMPDIR"] = str(here / "tmp")
        os.environ["XDG_STATE_HOME"] = str(root / "state")
        return guarded(case.words)

    child, end, code = forked(work, None if show else out), time.monotonic() + LIMIT, None
    while code is None and time.monotonic() < end:
        ended, status = os.waitpid(child, os.WNOHANG)
        code = os.waitstatus_to_exitcode(status) if ended else None
        time.sleep(0.005)
    if code is None:
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
    said = out.read_text("utf-8", "replace") if out.is_file() else ""
    after = snapshot(here)
    may = {"resume": "runs/r", "export": "runs/r/adversary", "bench": "runs/r/report"}.get(
        case.words[0], "\0"
    )
    touched = [p for p in before.keys() | after.keys() if before.get(p) != after.get(p)]
    touched = [path for path in touched if code != 0 or not path.startswith(may)]
    crashed = "Traceback (most" in said or "unexpected " in said or code not in (None, 0, 1, 2)
    found = (crashed, code is None, code == 0 and case.wrong, bool(touched))
    faults = [fault for fault, there in zip(FAULTS, found, strict=True) if there]
    if faults or show:
        told = (said.strip().splitlines() or ["–"])[-1]
        print(f"{name} {', '.join(faults)} (exit {code}): apil {' '.join(case.words)[:120]!r}")
        print(f"    {case.what[:120]!r}: {told[:300]!r} {touched[:3] or ''}", flush=True)
    shutil.rmtree(here)
    return code == 0, faults


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scale", type=float, default=1.0, help="share of the cases")
    parser.add_argument("--only", default="", help="FAMILY, or FAMILY:NUMBER of one case")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    asked = parser.parse_args(words)
    family, _, number = asked.only.partition(":")
    share = {
        name: max(round(count * asked.scale), 1) for name, count in COUNTS.items() if family in ("", name)
    }
    names = [asked.only] if number else [f"{name}:{i}" for name, count in share.items() for i in range(count)]
    for module in IMPORTED_ONCE:
        import_module(module)
    root = Path(tempfile.mkdtemp(prefix="apil-fuzz-"))
    # torch must start no threads before later forks, so seeds are made in a fork, too
    if os.waitpid(forked(lambda: make_seeds(root / "seeds"), root / "seeds.out"), 0)[1]:
        print((root / "seeds.out").read_text())
        return 1

    def part(first: int) -> None:
        with (root / "tally").open("a") as tally:
            for name in names[first :: asked.workers]:
                succeeds, faults = tried(name, root, bool(number))
                for what in ("cases", *["succeed"] * succeeds, *faults):
                    tally.write(f"{name.split(':')[0]} {what}\n")

    workers = [forked(partial(part, first), None) for first in range(asked.workers)]
    failed = sum(os.waitpid(worker, 0)[1] for worker in workers)
    counts = Counter((root / "tally").read_text().splitlines())
    shutil.rmtree(root)
    kinds = ("cases", "succeed", *FAULTS)
    print("".join(f"{head:>12}" for head in ("", *kinds)))
    for name in COUNTS:
        print(f"{name:>12}" + "".join(f"{counts[f'{name} {kind}']:12}" for kind in kinds))
    return int(failed > 0 or any(counts[f"{name} {kind}"] for name in COUNTS for kind in FAULTS))


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())

"""Learning speed of imitators on recorded games of a victim: the study behind docs/methods.md §2.

    APIL_RECORDING=games apil run --method adrl --env ENV --plugin benchmarks/imitation/recorder.py \\
        --set 'observers=[recorder]' ...
    python benchmarks/imitation/study.py games --env ENV

Every rollout is used once: an imitator is measured on it, then learns from it, as in training. The recorded
adversary does not see ã, so only imitation is measured.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from ruamel.yaml import YAML

from apil_core import RunConfig, make_game
from apil_core.api.method import Run
from apil_core.api.types import Rollout
from apil_core.common.torch_threads import one_torch_thread
from apil_core.config.resolve import resolve
from apil_core.plugins.registry import default_plugins
from apil_core.policies.loading import victim_side
from apil_core.training.build import build_hooks, method_setup

KEPT = (
    *("mse", "relative_error", "explained_share", "log_likelihood", "constant_log_likelihood"),
    *("imitator_std", "discriminator_accuracy_victim", "discriminator_accuracy_imitator"),
)
VARIANTS = Path(__file__).with_name("variants.yaml")
FORMATTER = argparse.RawDescriptionHelpFormatter


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=FORMATTER)
    parser.add_argument("recording", type=Path, help="directory of rollouts that recorder.py wrote")
    parser.add_argument("--env", required=True, help="game it was recorded in")
    parser.add_argument("--variants", type=Path, default=VARIANTS, help="YAML: name → settings of a run")
    parser.add_argument("--method", default="apil", help="apil or e_apil")
    parser.add_argument("--only", nargs="*", default=[], help="names of variants; default: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=int, default=10**6, help="rollouts to use at most")
    parser.add_argument("--out", type=Path, help="JSON file for all metrics")
    arguments = parser.parse_args()
    files = sorted(arguments.recording.glob("*.pt"))[: arguments.limit]
    if not files:
        parser.error(f"{arguments.recording}: no rollouts in it")
    variants = YAML(typ="safe").load(arguments.variants)
    found: dict[str, list[dict[str, float]]] = {}
    with one_torch_thread():
        for name, settings in variants.items():
            if arguments.only and name not in arguments.only:
                continue
            sets = [f"{key}={json.dumps(value)}" for key, value in settings.items()]
            config = resolve(
                sets=sets,
                flags={"method": arguments.method, "env": arguments.env, "seed": arguments.seed},
                plugins=default_plugins(),
            )
            begin = time.perf_counter()
            found[name] = imitate(config, files)
            print(table({name: found[name]})[0], f"{time.perf_counter() - begin:.0f} s", flush=True)
    if arguments.out:
        kept = {name: [{k: round(row[k], 4) for k in KEPT} for row in rows] for name, rows in found.items()}
        arguments.out.write_text(json.dumps(kept) + "\n")


def table(found: dict[str, list[dict[str, float]]]) -> list[str]:
    """Rows of Markdown: error after 10, 20, 40 and all rollouts, then shares, likelihood and D at the end."""
    lines = []
    for name, rows in found.items():
        ends = [end for end in (10, 20, 40) if end < len(rows)] + [len(rows)]
        errors = " / ".join(f"{mean(rows[:end], 'relative_error'):.2f}" for end in ends)
        likelihoods = [mean(rows, key) for key in ("log_likelihood", "constant_log_likelihood")]
        right = [mean(rows, f"discriminator_accuracy_{who}") for who in ("victim", "imitator")]
        cells = (
            *(name, errors, f"{mean(rows, 'explained_share'):.2f}"),
            *("{:.1f} ({:.1f})".format(*likelihoods), "{:.2f}/{:.2f}".format(*right)),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def mean(rows: list[dict[str, float]], key: str) -> float:
    """Mean over the last five of ``rows``, since single rollouts are noisy."""
    return sum(row[key] for row in rows[-5:]) / len(rows[-5:])


def imitate(config: RunConfig, files: list[Path]) -> list[dict[str, float]]:
    """Train APIL's own classes on recorded rollouts; return metrics per rollout, before learning from it."""
    plugins = default_plugins()
    torch.manual_seed(config.seed)
    game = make_game(config.env, num_envs=1, options=config.game, plugins=plugins)
    side = 1 - victim_side(config, plugins)
    device = torch.device("cpu")
    methods, hooks = build_hooks(config, plugins, method_setup(config, game.layout, side, device))
    game.close()
    apil: Any = methods["apil"]
    generator = torch.Generator().manual_seed(config.seed)
    run: Any = SimpleNamespace(
        config=config, hook=hooks.hook, generator=generator, device=device, steps=0, iteration=0
    )
    rows = []
    for file in files:
        data = torch.load(file, weights_only=True)
        rollout = recorded(data)
        states = apil.normalizer(rollout.victim_observation)
        with torch.no_grad():
            rollout.groups["prediction"] = apil.imitator(states).sample(generator)
        rows.append(dict(update(apil, run, rollout)))
        run.steps += rollout.steps
        run.iteration += 1
    return rows


def update(apil: Any, run: Run, rollout: Rollout) -> dict[str, float]:
    work = apil.update_auxiliary(run, rollout)
    result: dict[str, float] = work()
    return result


def recorded(data: dict[str, torch.Tensor]) -> Rollout:
    """Make a rollout with the fields that imitators read; the rest is empty."""
    shape = data["done"].shape
    nothing = torch.zeros(*shape, 0)
    fields = dict.fromkeys(Rollout.__dataclass_fields__, nothing) | {"groups": {}, "next_groups": {}}
    return Rollout(**fields | data)


if __name__ == "__main__":
    main()

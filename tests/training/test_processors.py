"""One seed, one result: the number of CPUs decides how fast it is, not what comes out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from helpers.small_runs import differences
from retraining.victims import student

from apil_core.plugins.registry import default_plugins
from apil_core.runs.distillation.build import named
from apil_core.runs.distillation.build import prepare as prepare_distillation
from apil_core.runs.distillation.config import DistillConfig
from apil_core.runs.retraining.build import prepare as prepare_retraining
from apil_core.runs.retraining.settings import settings
from apil_core.testing import tiny_config
from apil_core.training.build import build


def first_weights(evader: str) -> dict[str, Any]:
    plugins, wide = default_plugins(), (128, 128)
    attack = build(tiny_config("e_apil", victim=evader, ppo={"hidden": wide}), plugins)
    here, random = {"env": "toy-pursuit"}, "baseline:random/7x2"
    flags = {**here, "victim": evader, "ppo.hidden": wide, "adversary_share": 1}
    retraining = prepare_retraining(settings([random], flags), plugins)
    distilling = DistillConfig(**here, role="evader", teacher=evader, opponent=random, hidden=wide)
    distillation = prepare_distillation(named(distilling, plugins), plugins)
    return {
        "run": attack.learner.state_dict(),
        "methods": {name: method.state_dict() for name, method in attack.methods.items()},
        "retraining": retraining.learner.state_dict(),
        "distillation": distillation.learner.state_dict(),
    }


def test_first_weights_do_not_depend_on_the_number_of_cpus(tmp_path: Path) -> None:
    evader, before, found = student(tmp_path / "evader.safetensors"), torch.get_num_threads(), []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        found.append(first_weights(evader))
    torch.set_num_threads(before)
    assert not differences(*found)

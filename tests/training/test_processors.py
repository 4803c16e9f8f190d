"""One seed, one result: the number of CPUs decides how fast it is, not what comes out."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

FIRST_WEIGHTS = """
import hashlib, sys
from pathlib import Path

import torch
from apil_core.plugins.registry import default_plugins
from apil_core.runs.distillation.build import named, prepare as prepare_distillation
from apil_core.runs.distillation.config import DistillConfig
from apil_core.runs.retraining.build import prepare as prepare_retraining
from apil_core.runs.retraining.settings import settings
from apil_core.testing import tiny_config
from apil_core.training.build import build

from retraining.victims import student

plugins, wide = default_plugins(), (128, 128)
evader = student(Path(sys.argv[1] + '.safetensors'))
attack = build(tiny_config("e_apil", victim=evader, ppo={"hidden": wide}), plugins)
here, random = {"env": "toy-pursuit"}, "baseline:random/7x2"
flags = {**here, "victim": evader, "ppo.hidden": wide, "adversary_share": 1}
retraining = prepare_retraining(settings([random], flags), plugins)
distilling = DistillConfig(**here, role="evader", teacher=evader, opponent=random, hidden=wide)
student = prepare_distillation(named(distilling, plugins), plugins)
states = {
    "run": attack.learner.state_dict(),
    "methods": {name: method.state_dict() for name, method in attack.methods.items()},
    "retraining": retraining.learner.state_dict(),
    "distillation": student.learner.state_dict(),
}
assert torch.get_num_threads() == int(sys.argv[2])
for name, state in states.items():
    torch.save(state, sys.argv[1])
    print(name, hashlib.sha256(open(sys.argv[1], "rb").read()).hexdigest())
"""


def first_weights(path: Path, cpus: int) -> str:
    environment = {**os.environ, "OMP_NUM_THREADS": str(cpus), "PYTHONPATH": str(Path(__file__).parents[1])}
    command = [sys.executable, "-c", FIRST_WEIGHTS, str(path / "file"), str(cpus)]
    return subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout


def test_first_weights_do_not_depend_on_the_number_of_cpus(tmp_path: Path) -> None:
    one, two = (first_weights(tmp_path, cpus).splitlines() for cpus in (1, 2))
    assert len(one) == 4
    assert one == two

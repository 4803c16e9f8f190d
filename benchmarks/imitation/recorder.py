"""Observer that writes every rollout of a run to $APIL_RECORDING, for study.py and memory.py.

    APIL_RECORDING=games apil run --method adrl --env sumo-ants --plugin benchmarks/imitation/recorder.py \
        --set 'observers=[recorder]' --steps 1M
"""

from __future__ import annotations

import os
from pathlib import Path

import torch

from apil_core import Rollout, Run, hookimpl

APIL_HOOK_API = 2

KEPT = (
    *("victim_observation", "next_victim_observation", "victim_action", "victim_mean", "victim_std"),
    *("normalized_reward", "done"),
)
"""Fields that imitators of the victim read and are measured by: 30 MB for 16 384 steps of kick-and-defend."""


@hookimpl
def update_auxiliary(run: Run, rollout: Rollout) -> None:
    folder = Path(os.environ["APIL_RECORDING"])
    folder.mkdir(parents=True, exist_ok=True)
    values = {name: getattr(rollout, name).clone() for name in KEPT if getattr(rollout, name) is not None}
    torch.save(values, folder / f"{run.iteration:05d}.pt")

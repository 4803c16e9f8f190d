"""Which runs are one attack repeated: they differ in the seed, and otherwise in nothing that counts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from apil_core.config.game import stored_game
from apil_core.training.storage.run_dir import RunDir

_FREE: Any = {
    **dict.fromkeys(("seed", "threads", "device", "checkpoint", "recorders", "log_rows", "trust"), True),
    "evaluation": {"episodes", "every_steps", "periodic_episodes"},
}
"""Settings in which runs of one attack may differ."""


def seed_groups(runs: Sequence[RunDir]) -> list[list[int]]:
    """Places of runs in ``runs``, those together that differ in the seed only; in the order given.

    The number of processes is part of the attack: each adds its games to the batch. Two runs of one
    attack with one seed go into two groups: they are copies, not evidence.

    Raises:
        ApilError: one of them is no run directory.
    """
    groups: dict[tuple[str, int], list[int]] = {}
    copies: dict[tuple[str, int], int] = {}
    for place, run in enumerate(runs):
        config = run.config()
        played = config.model_copy(update={"game": stored_game(config)})
        attack = f"{run.processes()} {played.model_dump_json(exclude=_FREE)}"
        copy = copies.get((attack, config.seed), 0)
        copies[attack, config.seed] = copy + 1
        groups.setdefault((attack, copy), []).append(place)
    return list(groups.values())

"""The memory and the revision by hand; a run resumes exactly and passes every check of a method."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
import torch

from apil_core.testing import check_method, tiny_config, tiny_run
from apil_episodic.config import EpisodicConfig
from apil_episodic.memory import EpisodicMemory
from apil_episodic.method import Episodic


def test_the_memory_averages_the_nearest_and_replaces_the_oldest():
    memory = EpisodicMemory(capacity=3, size=1)
    memory.write(torch.tensor([[0.0], [10.0]]), torch.tensor([1.0, -1.0]))
    assert memory.look_up(torch.tensor([[1.0]]), n=3).tolist() == [0.0]  # only two are known
    assert memory.look_up(torch.tensor([[1.0], [9.0]]), n=1).tolist() == [1.0, -1.0]
    assert memory.look_up(torch.tensor([[1.0]]), n=2).tolist() == [0.0]
    memory.write(torch.tensor([[2.0], [4.0]]), torch.tensor([5.0, 7.0]))  # 4 takes the place of 0
    assert len(memory) == 3
    assert memory.look_up(torch.tensor([[0.0], [3.9]]), n=1).tolist() == [5.0, 7.0]
    assert memory.look_up(torch.tensor([[3.0]]), n=2).tolist() == [6.0]
    memory.write(torch.arange(5.0).unsqueeze(1), torch.arange(5.0))  # more than fit: the last three
    assert sorted(memory.returns.tolist()) == [2.0, 3.0, 4.0]


def episodic(**options) -> Episodic:
    setup = SimpleNamespace(
        adversary=SimpleNamespace(observation_size=1),
        layout=SimpleNamespace(max_steps=4),
        device=torch.device("cpu"),
        seed=0,
    )
    method = Episodic(EpisodicConfig(**{"projection": 1, **options}), setup)
    method.matrix = torch.ones(1, 1)
    method.normalizer.moments.count.fill_(1)  # identity: shift 0, scale 1
    return method


def rollout(first: list[int], done: list[int]) -> SimpleNamespace:
    return SimpleNamespace(
        first=torch.tensor(first).bool().unsqueeze(1), done=torch.tensor(done).bool().unsqueeze(1)
    )


def column(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32).unsqueeze(1)


def test_two_rollouts_by_hand():
    method = episodic(pattern_length=2, group_size=1, revision=0.5)
    # a game of three steps, s' = 1, 3, 4, that earns 2 + 0 + 4; then one that goes on, s' = 0
    revised = method.relabel_reward(
        rollout([1, 0, 0, 1], [0, 0, 1, 0]), column(2, 0, 4, 1), column(1, 3, 4, 0).unsqueeze(2)
    )
    assert revised[:, 0].tolist() == [2, 0, 4, 1]  # nothing was known yet
    # z = 1, then 1 + (3 − 1)/2 = 2 after two steps, then 2 + (4 − 2)/2 = 3 at the end
    assert method.memory.patterns[:2, 0].tolist() == [2, 3]
    assert method.memory.returns[:2].tolist() == [6, 6]
    method.memory.returns[1] = -6.0
    # the second goes on: z = 0 + (4 − 0)/2 = 2 → 6, then 2 + (4 − 2)/2 = 3 → −6
    revised = method.relabel_reward(rollout([0, 0], [0, 1]), column(1, 1), column(4, 4).unsqueeze(2))
    assert revised[:, 0].tolist() == [1 + 0.5 * (6 - 0), 1 + 0.5 * (-6 - 6)]
    assert method.memory.patterns[:4, 0].tolist() == [2, 3, 2, 3]  # after 2 steps, and at its end
    assert method.memory.returns[2:4].tolist() == [3, 3]


def test_without_weight_the_run_is_that_of_adrl(tmp_path):
    tiny_run(tiny_config("adrl", steps=4 * 512), tmp_path / "adrl")
    tiny_run(tiny_config("episodic", steps=4 * 512, options={"episodic": {"revision": 0}}), tmp_path / "e")
    rows = [
        json.loads((tmp_path / name / "metrics.jsonl").read_text("utf-8").splitlines()[-1])
        for name in ("adrl", "e")
    ]
    assert rows[0]["ppo/value"] == rows[1]["ppo/value"]
    assert rows[1]["episodic/remembered"] > 0


@pytest.mark.slow
def test_it_passes_every_check_of_a_method():
    print(check_method("episodic"))

"""What the plugin offers, and that offering it costs nothing."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch

from apil_core import VictimError, View
from apil_core.api.specs import load
from apil_core.policies import plugin


def view(games: int, size: int) -> View:
    own = torch.full((games, size), 7.0)
    return View(own=own, opponent=own, first=torch.ones(games, dtype=torch.bool))


@pytest.mark.parametrize(
    "code",
    [
        "import apil_core.policies.plugin as p; p.register_policies()",
        "from apil_core.policies.zoo import list_zoo; assert len(list_zoo()) == 19",
    ],
)
def test_neither_torch_nor_mujoco(code: str) -> None:
    check = "import sys; assert not {'torch', 'mujoco', 'pooch'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", f"{code}; {check}"], check=True)


def test_specs_resolve() -> None:
    specs = {spec.scheme: spec for spec in plugin.register_policies()}
    assert set(specs) == {"zoo", "baseline", "object"}
    for spec in specs.values():
        assert callable(load(spec.loader))
        assert spec.summary
    assert specs["zoo"].lister is not None
    assert len(load(specs["zoo"].lister)()) == 19


def test_random_baseline() -> None:
    policy = load("apil_core.policies.baseline:load")("random/384x17")
    assert policy.info.name == "baseline:random/384x17"
    decisions = [
        policy.act(view(400, 384), sample=True, generator=torch.Generator().manual_seed(1)) for _ in range(2)
    ]
    action = decisions[0].action
    assert torch.equal(action, decisions[1].action)
    assert action.shape == (400, 17)
    assert abs(float(action.mean())) < 0.05
    assert abs(float(action.std()) - 1) < 0.05
    assert decisions[0].distribution.log_prob(action).shape == (400,)
    assert not policy.act(view(2, 384), sample=False).action.any()


def test_zero_baseline() -> None:
    policy = load("apil_core.policies.baseline:load")("zero/137x8")
    decision = policy.act(view(3, 137), sample=True)
    assert decision.action.shape == (3, 8)
    assert not decision.action.any()
    assert decision.distribution is None


@pytest.mark.parametrize("name", ["random", "random/0x3", "noise/384x17", "zero/384x17/v1", ""])
def test_unknown_baseline(name: str) -> None:
    with pytest.raises(VictimError, match="known: random/OxA, zero/OxA"):
        load("apil_core.policies.baseline:load")(name)

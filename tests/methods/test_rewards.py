"""The methods' rewards against cases computed by hand."""

from __future__ import annotations

import math

import pytest
import torch
from helpers.small_runs import small_config

from apil_apil.discriminator import imitation_loss, reward_log_d, reward_neg_log_1md
from apil_core import RunConfig
from apil_core.api.game import GameLayout, GameStep, SideLayout
from apil_core.api.method import MethodSetup
from apil_core.api.types import Rollout, StepBatch
from apil_core.plugins.registry import default_plugins
from apil_core.training.build import build, build_hooks
from apil_core.training.rewards import RewardWeights, annealing, training_reward
from apil_core.training.trainer import Trainer


def setup_of(config):
    sides = (SideLayout("victim", 3, 2, -1.0, 1.0), SideLayout("adversary", 4, 1, -1.0, 1.0))
    layout = GameLayout(sides, 10, ("over",))
    return MethodSetup(layout, 1, torch.device("cpu"), 0, config.ppo, {})


def hooks_of(method, **options):
    config = RunConfig(method=method, env="toy-pursuit", options=options)
    return build_hooks(config, default_plugins(), setup_of(config))[1]


def step_with(reward, victim_reward):
    fields = dict.fromkeys(StepBatch.__dataclass_fields__, torch.zeros(len(reward)))
    return StepBatch(
        **{**fields, "reward": torch.tensor(reward), "victim_reward": torch.tensor(victim_reward)}
    )


def rollout_with(normalized_reward, normalized_victim_reward=None):
    fields = dict.fromkeys(
        (n for n in Rollout.__dataclass_fields__ if n not in ("groups", "next_groups", "advantages")),
        torch.zeros(1),
    )
    fields["normalized_reward"] = torch.tensor(normalized_reward)
    fields["normalized_victim_reward"] = torch.tensor(normalized_victim_reward or normalized_reward)
    return Rollout(**fields)


def terms(hooks, step):
    return hooks.merged(hooks.hook.shape_reward(run=None, step=step), "shape_reward")


# Three endings in training units (w_sparse = .01): the adversary wins (zero-sum), a tie that costs
# both 1000, and a keeper's win with both bonuses (kicker −1000, keeper +2000).
_NOT_ASKED = {"successors": None, "victim_successors": None}
"""Arguments that APL's hooks do not take."""

ENDINGS = ([10.0, -10.0, 20.0], [-10.0, -10.0, -10.0])


@pytest.mark.parametrize("method", ["apl", "apil", "e_apil"])
def test_reward_difference_where_the_game_is_not_zero_sum(method):
    step = step_with(*ENDINGS)
    total = step.reward + sum(terms(hooks_of(method), step).values())
    assert total.tolist() == [20.0, 0.0, 30.0]


def test_adrl_adds_nothing():
    assert terms(hooks_of("adrl"), step_with(*ENDINGS)) == {}


def test_advantage_difference_replaces_the_reward_term():
    hooks = hooks_of("apl", apl={"advantage_difference": True})
    assert terms(hooks, step_with(*ENDINGS)) == {}
    rollout = rollout_with([[0.0], [0.0]], [[3.0], [5.0]])
    streams = hooks.merged(
        hooks.hook.finish_rollout(run=None, rollout=rollout, **_NOT_ASKED), "finish_rollout"
    )
    assert streams["victim"].tolist() == [[3.0], [5.0]]
    mixed = hooks.hook.combine_advantages(
        run=None,
        rollout=rollout,
        streams={"reward": torch.tensor([[1.0], [3.0]]), "victim": torch.tensor([[10.0], [-30.0]])},
    )
    # each to mean 0, std 1 (n − 1): ∓1/√2 minus ±1/√2
    torch.testing.assert_close(mixed, torch.tensor([[-math.sqrt(2.0)], [math.sqrt(2.0)]]))


def test_imitation_reward_is_log_d():
    hooks = hooks_of("apil")
    logits = torch.tensor([[0.0, 1.0, -1.0]])
    reward = hooks.hook.imitation_reward(run=None, rollout=rollout_with([[9.0, 9.0, 9.0]]), logits=logits)
    d = [0.5, 1 / (1 + math.exp(-1.0)), 1 / (1 + math.exp(1.0))]
    torch.testing.assert_close(reward, torch.tensor([[math.log(x) for x in d]]))


@pytest.mark.parametrize("beta", [1.0, 0.5, 0.0])
def test_e_apil_pays_the_adversarys_reward_with_a_minus(beta):
    hooks = hooks_of("e_apil", e_apil={"beta": beta})
    answers = hooks.hook.imitation_streams(run=None, rollout=rollout_with([[0.0, 2.0, -3.0]]))
    if not beta:
        assert answers == []  # APIL, to the bit
        return
    ((weight, reward),) = answers[0].values()
    assert weight == beta
    assert reward.tolist() == [[0.0, -2.0, 3.0]]


def test_the_published_codes_reward():
    hooks = hooks_of("apil", apil={"reward": "neg_log_1md"})
    reward = hooks.hook.imitation_reward(
        run=None, rollout=rollout_with([[0.0]]), logits=torch.tensor([[1.0]])
    )
    d = 1 / (1 + math.exp(-1.0))
    torch.testing.assert_close(reward, torch.tensor([[-math.log(1 - d)]]))


def test_discriminator_loss_by_hand():
    # D(victim) = .75, D(imitator) = .25: −log .75 − log(1 − .25)
    logit = math.log(3.0)
    loss = imitation_loss(torch.tensor([logit]), torch.tensor([-logit]))
    assert float(loss) == pytest.approx(-2 * math.log(0.75))
    assert float(reward_log_d(torch.tensor(logit))) == pytest.approx(math.log(0.75))
    assert float(reward_neg_log_1md(torch.tensor(logit))) == pytest.approx(-math.log(0.25))


def game_step(sparse, shaping):
    import numpy as np

    zeros = np.zeros(1)
    as_rows = [np.array([[a], [b]], dtype=np.float32) for a, b in (sparse, shaping)]
    return GameStep(as_rows[0], as_rows[1], as_rows[1], zeros > 1, zeros, zeros, zeros)


def test_training_reward_mixes_dense_and_sparse():
    weights = RewardWeights(dense_weight=0.1, sparse_weight=0.01, anneal_fraction=0.5)
    step = game_step((1000.0, -1000.0), (2.0, -4.0))
    # c = .25: .25·.1·2 + .75·.01·1000 = 7.55;  .25·.1·(−4) + .75·.01·(−1000) = −7.6
    reward = training_reward(step, weights, 0.25)
    assert reward[:, 0].tolist() == pytest.approx([7.55, -7.6])
    assert training_reward(step, weights, 0.0)[:, 0].tolist() == pytest.approx([10.0, -10.0])


def test_annealing_is_linear_then_zero():
    weights = RewardWeights(anneal_fraction=0.1)
    assert [annealing(weights, s, 1000) for s in (0, 50, 100, 900)] == [1.0, 0.5, 0.0, 0.0]
    assert annealing(RewardWeights(), 0, 1000) == 0.0


def test_a_share_of_fixed_steps_does_not_change_with_the_budget():
    plugins = default_plugins()
    found = []
    for steps in (2048, 8192):
        reward = {"dense_weight": 1.0, "sparse_weight": 1.0, "anneal_fraction": 0.5, "anneal_budget": 1024}
        config = small_config("adrl", num_envs=32, steps=steps, ppo={"num_steps": 16}, reward=reward)
        trainer = Trainer(build(config, plugins), plugins)
        found.append([trainer.iterate()["reward/adversary"] for _ in range(2)])
        trainer.attack.game.close()
    assert found[0] == found[1]

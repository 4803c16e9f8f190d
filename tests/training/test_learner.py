"""rsl_rl behind one file: a contract test for its moving API, its own runner on our env, PPO's settings."""

from __future__ import annotations

import copy
import math
from pathlib import Path

import pytest
import torch
from helpers.every_game import GAME_NAMES
from helpers.small_runs import differences, small_config
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

from apil_core.api.types import OWN_GROUP, PRIVILEGED_GROUP, DiagonalGaussian
from apil_core.evaluation.progress import Progress
from apil_core.plugins.registry import default_plugins
from apil_core.runs.score import score_in_training
from apil_core.training.attack_env import AttackEnv
from apil_core.training.build import build
from apil_core.training.ppo import Actor, Learner
from apil_core.training.ppo_storage import LATENT, Gaussian, PPOStorage
from apil_core.training.rollout_buffer import RolloutBuffer
from apil_core.training.storage import checkpoint
from apil_core.training.trainer import Trainer


def small_learner(**ppo):
    torch.manual_seed(0)
    config = small_config(ppo={"num_steps": 4, "epochs": 2, "minibatches": 2, **ppo}).ppo
    example = TensorDict({"own": torch.randn(8, 3), "extra": torch.randn(8, 2)}, batch_size=[8])
    actor = Actor({"own": 3, "extra": 2}, 2, config)
    return Learner(actor, example, RolloutBuffer(4), config, torch.device("cpu")), example


def roll(learner, example, reward=None):
    for t in range(learner.config.num_steps):
        action = learner.act(example)
        value = torch.randn(8) if reward is None else reward(action)
        write(learner, t, action, value, torch.full((8,), t % 2 == 1))


def write(learner, t, action, reward, done):
    """What the environment does with an action."""
    storage = learner.storage
    storage.actions[t], storage.rewards[t, :, 0], storage.dones[t, :, 0] = action, reward, done


def test_settings_that_differ_from_rsl_rls_defaults():
    learner, _ = small_learner(value_coefficient=0.5)
    ppo = learner.ppo
    assert ppo.schedule == "fixed"
    assert ppo.use_clipped_value_loss
    assert not small_learner(clip_value=False)[0].ppo.use_clipped_value_loss
    assert ppo.value_loss_coef == 0.25  # ½ · 0.5: rsl_rl's value loss has no ½
    assert {group["eps"] for group in ppo.optimizer.param_groups} == {1e-5}
    assert [type(layer).__name__ for layer in learner.actor.model.mlp] == ["Linear", "Tanh"] * 2 + ["Linear"]
    assert learner.actor.model.obs_groups == ["own", "extra"]


def test_actions_in_units_of_a_motors_limit():
    torch.manual_seed(0)
    game, limit = (small_config(ppo={"action_unit": unit, "init_std": 0.5}).ppo for unit in ("game", "limit"))
    plain, scaled = Actor({"own": 3}, 2, game, 0.4), Actor({"own": 3}, 2, limit, 0.4)
    scaled.model.mlp.load_state_dict(plain.model.mlp.state_dict())
    observations = TensorDict({"own": torch.randn(8, 3)}, batch_size=[8])
    torch.testing.assert_close(scaled(observations).mean, 0.4 * plain(observations).mean)
    torch.testing.assert_close(plain.std, torch.full((2,), 0.5))
    torch.testing.assert_close(scaled.std, torch.full((2,), 0.2))
    torch.testing.assert_close(scaled.hidden(observations), plain.hidden(observations))


def test_our_distribution_is_rsl_rls():
    learner, example = small_learner()
    actions = learner.act(example)
    ours = learner.actor(example)
    learner.actor.model(example, stochastic_output=True)
    torch.testing.assert_close(ours.log_prob(actions), learner.actor.model.get_output_log_prob(actions))
    torch.testing.assert_close(ours.entropy(), learner.actor.model.output_entropy)
    torch.testing.assert_close(ours.mean, learner.actor.model(example))
    assert learner.actor.hidden(example).shape == (8, 64)


def test_a_rollout_tells_what_the_adversarys_actions_were_drawn_from():
    attack = build(small_config("adrl", num_envs=4, ppo={"num_steps": 8}), default_plugins())
    trainer, seen = Trainer(attack, default_plugins()), []
    learn = trainer._learn

    def spy(rollout, actor_fixed):
        before = attack.learner.actor.std.detach().clone()
        metrics = learn(rollout, actor_fixed)
        seen.append((rollout, before))
        return metrics

    trainer._learn = spy
    trainer.iterate()
    ((rollout, std),) = seen
    storage = attack.learner.storage
    for ours, theirs in (("action", "actions"), ("shaped_reward", "rewards"), ("done", "dones")):
        assert getattr(rollout, ours).data_ptr() == getattr(storage, theirs).data_ptr(), (
            "one rollout, two views"
        )
    assert rollout.action_mean.shape == rollout.action_std.shape == rollout.action.shape
    assert torch.equal(
        rollout.action_std, std.expand_as(rollout.action)
    )  # the update has changed the actor's
    drawn = DiagonalGaussian(rollout.action_mean, rollout.action_std)
    log_prob = drawn.log_prob(rollout.action)
    torch.testing.assert_close(log_prob, storage.actions_log_prob[..., 0])
    # plugins may train on it
    (rollout.action_mean * torch.ones((), requires_grad=True)).sum().backward()


def test_minibatches_are_rsl_rls_but_for_the_copying():
    learner, example = small_learner()
    roll(learner, example)
    learner.advantages(example, {})
    storage = learner.storage
    storage.distribution_params = (storage.means, storage.means)
    batches = []
    for generator in (storage.mini_batch_generator, super(PPOStorage, storage).mini_batch_generator):
        torch.manual_seed(1)
        batches.append(list(generator(2, 3)))
    ours, theirs = batches
    assert len(ours) == len(theirs) == 6
    for mine, other in zip(ours, theirs, strict=True):
        for name in ("actions", "values", "advantages", "returns", "old_actions_log_prob"):
            assert torch.equal(getattr(mine, name), getattr(other, name)), name
        assert torch.equal(mine.observations[LATENT], other.observations[LATENT])


def test_no_sample_is_left_out_of_all_passes():
    """Seven samples in two minibatches of three: the one that is left out is another each time."""
    example = TensorDict({OWN_GROUP: torch.zeros(7, 2)}, batch_size=[7])
    storage = PPOStorage(example, RolloutBuffer(1), 1, torch.device("cpu"))
    storage.returns.copy_(torch.arange(7.0).view(1, 7, 1))
    torch.manual_seed(0)
    passes = [list(storage.mini_batch_generator(2, 1)) for _ in range(30)]
    assert all(len(batch.returns) == 3 for batches in passes for batch in batches)
    assert {float(x) for batches in passes for batch in batches for x in batch.returns} == set(range(7))


def test_the_updates_densities_are_torchs():
    gaussian = Gaussian(3, init_std=0.5, std_type="log")
    means, actions = torch.randn(4, 3), torch.randn(4, 3)
    gaussian.log_std_param.data += torch.tensor([0.0, 1.0, -1.0])
    gaussian.update(means)
    expected = torch.distributions.Normal(means, gaussian.log_std_param.exp().expand(4, 3))
    torch.testing.assert_close(gaussian.log_prob(actions), expected.log_prob(actions).sum(-1))
    torch.testing.assert_close(gaussian.entropy, expected.entropy().sum(-1))
    torch.testing.assert_close(gaussian.params, (expected.mean, expected.stddev))


def test_a_checkpoint_of_the_slower_adam_goes_on_with_the_fused_one():
    learner, example = small_learner()
    roll(learner, example)
    learner.update(learner.advantages(example, {})["reward"], as_given=False, learning_rate=1e-3)
    state = copy.deepcopy(learner.state_dict())
    (group,) = state["ppo"]["optimizer_state_dict"]["param_groups"]
    group["fused"] = None
    learner, _ = small_learner()
    learner.load_state_dict(state)
    assert learner.ppo.optimizer.param_groups[0]["fused"]
    saved, loaded = state["ppo"]["optimizer_state_dict"]["state"], learner.ppo.optimizer.state_dict()["state"]
    assert all(torch.equal(saved[i][key], loaded[i][key]) for i in saved for key in saved[i])


def test_the_rollout_keeps_what_the_networks_said_in_each_step():
    learner, example = small_learner()
    seen, actions = [], []
    for t in range(4):
        observations = example.apply(lambda value, t=t: value + t)
        seen.append(observations)
        actions.append(learner.act(observations))
        write(learner, t, actions[-1], torch.zeros(8), torch.zeros(8, dtype=torch.bool))
    learner.advantages(example, {})
    for t in range(4):
        torch.testing.assert_close(learner.storage.values[t], learner.ppo.critic(seen[t]))
        expected = learner.actor(seen[t]).log_prob(actions[t])
        torch.testing.assert_close(learner.storage.actions_log_prob[t, :, 0], expected)


def test_a_method_may_call_a_group_latent():
    config = small_config(ppo={"num_steps": 4, "epochs": 1, "minibatches": 2}).ppo
    example = TensorDict({"own": torch.randn(8, 3), LATENT: torch.randn(8, 2)}, batch_size=[8])
    learner = Learner(
        Actor({"own": 3, LATENT: 2}, 2, config), example, RolloutBuffer(4), config, torch.device("cpu")
    )
    roll(learner, example)
    advantages = learner.advantages(example, {})["reward"]
    learner.update(advantages, as_given=False, learning_rate=1e-3)
    assert learner.actor(example).mean.shape == (8, 2)


def test_our_gae_is_rsl_rls():
    learner, example = small_learner()
    roll(learner, example)
    ours = learner.advantages(example, {})["reward"].clone()
    targets = learner.storage.returns.clone()
    learner.ppo.compute_returns(example)
    torch.testing.assert_close(targets, learner.storage.returns)
    theirs = learner.storage.returns - learner.storage.values
    torch.testing.assert_close(ours, theirs[..., 0])


def test_an_update_raises_what_paid():
    learner, example = small_learner(epochs=10, learning_rate=3e-3)
    before = learner.actor(example).mean.detach().clone()
    for _ in range(10):
        roll(learner, example, reward=lambda action: action[:, 0])
        advantages = learner.advantages(example, {})["reward"]
        metrics = learner.update(advantages, as_given=False, learning_rate=3e-3)
    after = learner.actor(example).mean.detach()
    assert float((after - before)[:, 0].mean()) > 0.1
    assert metrics["ppo/kl"] > 0
    assert metrics["ppo/learning_rate"] == 3e-3


@pytest.mark.parametrize(("max_kl", "passes"), [(None, 5), (1e3, 5), (1e-9, 1)])
def test_passes_end_once_the_policy_is_too_far(max_kl, passes):
    learner, example = small_learner(epochs=5, max_kl=max_kl)
    roll(learner, example)
    advantages = learner.advantages(example, {})["reward"]
    metrics = learner.update(advantages, as_given=False, learning_rate=3e-3)
    assert metrics["ppo/passes"] == passes
    # the entropy of a unit Gaussian of two components, whatever the passes: a mean over those that were made
    assert metrics["ppo/entropy"] == pytest.approx(1 + math.log(2 * math.pi), abs=0.2)


def test_a_stream_has_its_own_critic_that_learns():
    learner, example = small_learner(epochs=20, learning_rate=3e-3)
    losses = []
    for _ in range(20):
        roll(learner, example)
        streams = {"victim": torch.ones(4, 8)}
        advantages = learner.advantages(example, streams)
        assert advantages["victim"].shape == (4, 8)
        metrics = learner.update(advantages["reward"], as_given=True, learning_rate=3e-3)
        losses.append(metrics["ppo/value_victim"])
    assert losses[-1] < 0.5 * losses[0]


def test_state_round_trip():
    learner, example = small_learner()
    roll(learner, example)
    learner.update(
        learner.advantages(example, {"victim": torch.ones(4, 8)})["reward"],
        as_given=False,
        learning_rate=1e-3,
    )
    state = copy.deepcopy(learner.state_dict())
    other, _ = small_learner()
    other.load_state_dict(state)
    for name in ("actor", "critic"):
        a, b = getattr(learner.ppo, name), getattr(other.ppo, name)
        assert all(torch.equal(x, y) for x, y in zip(a.parameters(), b.parameters(), strict=True))
    assert other.critics.keys() == {"victim"}


def rsl_rls_runner(env: AttackEnv, groups: list[str], steps: int, log_dir: Path) -> OnPolicyRunner:
    """rsl_rl's own trainer with a small network, as anyone would set it up."""
    model = {"class_name": "rsl_rl.models:MLPModel", "hidden_dims": [16], "activation": "tanh"}
    config = {
        "num_steps_per_env": steps,
        "save_interval": 100,
        "logger": "tensorboard",
        "obs_groups": {"actor": groups, "critic": groups},
        "actor": {
            **model,
            "distribution_cfg": {"class_name": "rsl_rl.modules.distribution:GaussianDistribution"},
        },
        "critic": dict(model),
        "algorithm": {"class_name": "rsl_rl.algorithms:PPO", "schedule": "fixed"},
    }
    return OnPolicyRunner(env, config, log_dir=str(log_dir), device="cpu")


@pytest.mark.parametrize("method", ["adrl", "e_apil"])
def test_rsl_rls_own_runner_plays_our_env(tmp_path, method):
    attack = build(small_config(method), default_plugins())
    runner = rsl_rls_runner(attack.env, list(attack.builder.sizes), 8, tmp_path)
    runner.learn(3)
    assert attack.env.steps == 3 * 8 * 32
    assert attack.env.get_observations().batch_size == (32,)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("game", GAME_NAMES)
def test_rsl_rls_own_runner_plays_every_game(tmp_path, game, side):
    """From both seats, with games that end and restart in between."""
    config = small_config("adrl", env=game, victim="random", victim_side=1 - side, num_envs=4)
    config = config.model_copy(update={"game": {"max_steps": 10}})
    attack = build(config, default_plugins())
    runner = rsl_rls_runner(attack.env, list(attack.builder.sizes), 8, tmp_path)
    runner.learn(3)
    assert attack.env.steps == 3 * 8 * 4
    seat = attack.game.layout.sides[side]
    sizes = {name: tuple(part.shape) for name, part in attack.env.get_observations().items()}
    assert (4, seat.observation_size) in sizes.values()
    assert attack.env.num_actions == seat.action_size
    assert (attack.env.episode_length_buf <= 10).all()
    assert all(torch.isfinite(p).all() for p in runner.alg.actor.parameters())


def test_critics_can_be_given_what_the_victim_sees_and_the_time_left(tmp_path):
    plugins = default_plugins()
    two = {"apl": {"advantage_difference": True}}
    config = small_config("apl", num_envs=4, ppo={"num_steps": 8, "critic_observes": "both"}, options=two)
    trainer = Trainer(build(config, plugins), plugins)
    attack = trainer.attack
    for _ in range(3):
        trainer.iterate()
    theirs = attack.game.layout.sides[1 - trainer.adversary_side].observation_size
    seen = attack.env.get_observations()[PRIVILEGED_GROUP]
    left = 1 - 2 * attack.env.episode_length_buf / attack.game.layout.max_steps
    torch.testing.assert_close(seen[:, -1], left)
    torch.testing.assert_close(seen[:, :-1], attack.env.privileged(attack.env.pending.view.opponent))
    width = sum(attack.builder.sizes.values())
    assert attack.learner.actor.model.mlp[0].in_features == width
    critics = [attack.learner.ppo.critic, *(critic.model for critic in attack.learner.critics.values())]
    assert {critic.mlp[0].in_features for critic in critics} == {width + theirs + 1}
    assert len(critics) == 2
    weight = attack.learner.ppo.critic.mlp[0].weight
    assert weight.grad[:, width:].abs().max() > 0
    # evaluation needs nothing of it, and a restored trainer goes on to the bit
    score_in_training(trainer, 4, Progress())
    checkpoint.save(tmp_path / "middle.pt", trainer.state_dict())
    again = Trainer(build(config, plugins), plugins)
    ends = []
    for each in (trainer, again):
        each.load_state_dict(checkpoint.read(tmp_path / "middle.pt"))
        each.iterate()
        checkpoint.save(tmp_path / "end.pt", each.state_dict())
        ends.append(checkpoint.read(tmp_path / "end.pt"))
    assert differences(*ends) == []

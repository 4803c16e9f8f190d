"""Start from any policy: clone it into the adversary's network, then fit the critic.

Like DAgger (Ross et al. 2011): mostly the clone plays, and the teacher labels its states. The
network is the run's own, so that all else stays as it is: exact resume, export, methods' added inputs.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import ceil
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from apil_core.api.config import RunConfig
from apil_core.api.policy import Policy
from apil_core.api.types import OWN_GROUP
from apil_core.common.errors import ConfigError
from apil_core.common.seeds import stream_generator, stream_seed
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.policies.loading import LoadOptions, load_victim
from apil_core.runs.distillation.build import spread_of

if TYPE_CHECKING:
    from apil_core.training.trainer import Trainer
from apil_core.runs.score import score_in_training

CLONING_SHARE = 0.6
"""Share of the steps for cloning; in the others the critic is fitted to the clone."""

_PASSES = 3
"""Passes over each rollout, and over as many earlier ones."""
_FINAL_PASSES = 30
_MINIBATCH = 512
_LEARNING_RATE = 3e-3
"""Adam's step size; the zoo's networks have large weights, which small steps do not reach."""


def load_teacher(trainer: Trainer, name: str) -> Policy:
    """Load the policy to clone, and check it.

    Raises:
        ConfigError: its sizes are not the adversary's, or there are not enough steps for it.
        VictimError: it cannot be loaded, or has no action distribution of constant spread.
    """
    config, side, seats = trainer.config, trainer.adversary_side, trainer.layout.sides
    if trainer.world.size > 1:
        raise ConfigError(
            f"init_from: one process clones {name}: begin without torchrun, then go on from the run it makes"
        )
    if (needed := _rollouts(config)[1] * config.rollout_steps) >= config.steps:
        raise ConfigError(
            f"init_from: cloning {name} takes {needed:,} of the run's steps ({config.steps:,}; init_steps "
            f"{config.init_steps:,} in rollouts of {config.rollout_steps:,}), which leaves none; "
            "set init_steps or steps"
        )
    load_options = LoadOptions(config.trust, stream_seed(config.seed, "warm start"), second=True)
    teacher = load_victim(name, trainer.attack.game, side, config.device, trainer.plugins, load_options)
    spread_of(teacher, seats[side], seats[1 - side], trainer.device)
    return teacher


def _rollouts(config: RunConfig) -> tuple[int, int]:
    """Rollouts in which the policy is cloned, and in all: at least one is left to fit the critic."""
    share = config.init_steps / config.rollout_steps
    whole = max(ceil(share), 2)
    return min(ceil(CLONING_SHARE * share), whole - 1), whole


def warm_start(trainer: Trainer, teacher: Policy) -> None:
    """Clone the teacher into the adversary and fit its critic, in ``init_steps`` of the budget.

    Args:
        trainer: of a run that has not started.
        teacher: from :func:`load_teacher`.
    """
    begin = time.perf_counter()
    cloning = _Cloning(trainer, teacher)
    for _ in range(_rollouts(trainer.config)[0]):
        cloning.round()
    cloning.finish()
    trainer.iterate(actor_fixed=True)
    while trainer.steps < trainer.config.init_steps:
        trainer.iterate(actor_fixed=True)
    trainer.iteration, trainer.wall_seconds = 0, time.perf_counter() - begin


def beside_teacher(trainer: Trainer, teacher: Policy, progress: Progress) -> str:
    """Score the clone and its teacher in the same games; return one line."""
    episodes = trainer.config.evaluation.periodic_episodes
    seed = stream_seed(trainer.config.seed, "evaluation during training")
    clone = score_in_training(trainer, episodes, progress, seed=seed)
    own = score_in_training(trainer, episodes, progress, seed=seed, adversary=teacher)
    return (
        f"warm start: after {trainer.steps:,} steps the clone wins {_wins(clone)} of {episodes} games, "
        f"{teacher.info.name} itself {_wins(own)}"
    )


def _wins(result: EvaluationResult) -> str:
    rate = result.win_rate
    return f"{rate.value:.1%} [{rate.low:.1%}, {rate.high:.1%}]"


_Block = tuple[Tensor, Tensor]
"""A rollout: the adversary's raw observations (T·n, o), and the teacher's means in units of σ (T·n, a)."""


class _Cloning:
    """Behaviour cloning of the teacher into the adversary's network (DAgger)."""

    def __init__(self, trainer: Trainer, teacher: Policy):
        self.trainer = trainer
        self.teacher = teacher
        attack = trainer.attack
        self.env, self.actor = attack.env, attack.learner.actor
        side, seats = trainer.adversary_side, trainer.layout.sides
        log_std, _ = spread_of(teacher, seats[side], seats[1 - side], trainer.device)
        self.std = log_std.exp()
        with torch.no_grad():
            self.actor.model.distribution.log_std_param.copy_(log_std)
            self.actor.model.mlp[0].weight[:, self._added()] = 0.0
        self.optimizer = torch.optim.Adam(self.actor.model.mlp.parameters(), _LEARNING_RATE)
        self.draws = stream_generator(trainer.config.seed, "warm start draws", trainer.device)
        self.order = stream_generator(trainer.config.seed, "warm start order", torch.device("cpu"))
        self.blocks: list[_Block] = []

    def _added(self) -> Tensor:
        """Mask of the network's inputs that are not the adversary's own observation, (k,) bool."""
        sizes = self.actor.groups
        return torch.cat([torch.full((size,), name != OWN_GROUP) for name, size in sizes.items()])

    def round(self) -> None:
        """Play a rollout and train on it and on earlier ones."""
        block = self._play()
        earlier = self.blocks[:]
        self.blocks.append(block)
        for _ in range(_PASSES):
            chosen = [block]
            if earlier:
                chosen.append(earlier[int(torch.randint(len(earlier), (), generator=self.order))])
            self._train(chosen)

    def finish(self) -> None:
        """Train on all rollouts, with a step size that falls to zero."""
        for i in range(_FINAL_PASSES):
            for group in self.optimizer.param_groups:
                group["lr"] = _LEARNING_RATE * (1 - i / _FINAL_PASSES)
            self._train(self.blocks)

    @torch.inference_mode()
    def _play(self) -> _Block:
        env, n = self.env, self.env.num_envs
        row = torch.arange(n, device=env.device)
        # every fourth game is the teacher's, so that the states it reaches are seen; the first rollout all
        clones = (row % 4 != 3 if self.blocks else torch.zeros_like(row, dtype=torch.bool)).unsqueeze(1)
        observations, labels = [], []
        for _ in range(self.trainer.config.ppo.num_steps):
            inputs, pending = env.get_observations(), env.pending
            answer = self.teacher.act(pending.view, sample=False).distribution
            assert answer is not None, "looked at before"
            mean = torch.where(clones, self.actor(inputs).mean, answer.mean)
            noise = torch.randn(mean.shape, generator=self.draws, device=env.device)
            observations.append(pending.view.own.clone())
            labels.append(answer.mean / self.std)
            env.step(mean + self.std * noise)
        env.finish_rollout()
        with torch.inference_mode(False):
            return torch.cat(observations).clone(), torch.cat(labels).clone()

    def _train(self, blocks: Sequence[_Block]) -> None:
        """Train one pass: KL(teacher ‖ clone) in nats, which is half the squared error in units of σ."""
        mlp = self.actor.model.mlp
        normalizer = self.trainer.attack.builder.normalizers[OWN_GROUP]
        added = self._added()
        for observation, label in blocks:
            with torch.no_grad():
                inputs = torch.zeros(len(label), len(added), device=label.device)
                inputs[:, ~added] = normalizer(observation)
            for rows in torch.randperm(len(inputs), generator=self.order).split(_MINIBATCH):
                error = mlp(inputs[rows]) / self.std - label[rows]
                self.optimizer.zero_grad()
                error.square().sum(-1).mean().mul(0.5).backward()
                nn.utils.clip_grad_norm_(mlp.parameters(), 10.0)
                self.optimizer.step()

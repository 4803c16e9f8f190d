"""The victim's inside for white-box methods: its decisions in a rollout, made again with gradients."""

from __future__ import annotations

import torch
from torch import Tensor

from apil_core.api.game import GameLayout
from apil_core.api.policy import Policy
from apil_core.api.types import Decision, DiagonalGaussian, Rollout, View
from apil_core.common.errors import PluginError, VictimError
from apil_core.training.attack_env import AttackEnv


class VictimInside:
    """The victim of a run's training games; see :class:`apil_core.api.method.WhiteBox`.

    Args:
        env: the training games, which keep the victim's states.
    """

    def __init__(self, env: AttackEnv):
        self._env = env
        self.info = env.victim.info

    def replay(self, rollout: Rollout, observation: Tensor | None = None) -> Decision:
        """See :meth:`apil_core.api.method.WhiteBox.replay`."""
        if rollout.action_mean is None:
            raise PluginError("run.victim.replay: this rollout is not one of the training games")
        seen = rollout.victim_observation if observation is None else observation
        policy, before = self._env.victim, self._env.victim.recurrent_state()
        policy.load_recurrent_state(self._env.victim_states[0])
        views = map(View, seen, rollout.observation, rollout.first)
        try:
            with torch.enable_grad():
                steps = [policy.act(view, sample=False, activations=True) for view in views]
        finally:
            policy.load_recurrent_state(before)
        given = [step.distribution for step in steps if step.distribution is not None]
        mean = torch.stack([each.mean for each in given])
        std = torch.stack([each.std.expand_as(each.mean) for each in given])
        layers = [step.activations or {} for step in steps]
        hidden = {name: torch.stack([layer[name] for layer in layers]) for name in layers[0]}
        return Decision(mean, DiagonalGaussian(mean, std), hidden)


def check_differentiable(policy: Policy, layout: GameLayout, side: int, device: torch.device) -> None:
    """Check that gradients reach what a victim sees, by one action at the start of a game.

    Args:
        policy: that has not acted yet.
        layout: of the game.
        side: the victim's.
        device: of the policy.

    Raises:
        VictimError: they do not.
    """
    own, other = (torch.zeros(1, layout.sides[i].observation_size, device=device) for i in (side, 1 - side))
    before, new = policy.recurrent_state(), torch.ones(1, dtype=torch.bool, device=device)
    try:
        distribution = policy.act(View(own.requires_grad_(), other, new), sample=False).distribution
    except RuntimeError:  # numpy() of a tensor that requires gradients
        distribution = None
    policy.load_recurrent_state(before)
    if distribution is None or not distribution.mean.requires_grad:
        raise VictimError(
            f"the method sees inside its victim (white_box), and {policy.info.name} has no gradients; "
            "zoo:, embedded: and safetensors: agents and hardened victims have"
        )

"""CVA's hooks: the bonus, the victim's advantage, and the update of the networks behind both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from apil_core import (
    Method,
    MethodSetup,
    ObservationNormalizer,
    Rollout,
    Run,
    gae,
    hookimpl,
    normalize_advantages,
)
from apil_cva.config import CvaConfig
from apil_cva.curiosity import Curiosity
from apil_cva.surrogate import Surrogate

STREAM = "curiosity"
"""Name of the bonus among the reward streams."""


@dataclass
class Looked:
    """One rollout evaluated with the weights before this iteration's updates; shared between hooks.

    Attributes:
        states: the surrogate's normalised input, (T, n, s).
        inputs: of the random networks, (T, n, i).
        values: V̂_ν(s_t), (T, n).
        fresh: the input statistics already hold this rollout, the first one.
        bonus: mean of the raw bonus.
        victim_advantages: Â_ν, (T, n).
    """

    states: Tensor
    inputs: Tensor
    values: Tensor
    fresh: bool
    victim_advantages: Tensor
    bonus: float = 0.0

    @property
    def returns(self) -> Tensor:
        """The surrogate's targets, (T, n)."""
        return self.victim_advantages + self.values


class Cva(Method):
    """Â = norm(Â_α) − w · norm(Â_ν) + β · norm(Â_c) (Gong et al. 2022)."""

    options: CvaConfig

    def __init__(self, options: CvaConfig, setup: MethodSetup):
        super().__init__(options, setup)
        device, watched = setup.device, options.curiosity.input
        self.sights = {
            sight: ObservationNormalizer(self._size(sight)).to(device)
            for sight in dict.fromkeys((options.surrogate.observes, watched))
            if sight != "surrogate"
        }
        self.surrogate = Surrogate(self._size(options.surrogate.observes), options.surrogate, device)
        size = options.surrogate.hidden[-1] if watched == "surrogate" else self._size(watched)
        self.curiosity = Curiosity(size, options.curiosity, setup.ppo.gamma, device)
        self.looked: Looked | None = None

    @hookimpl
    def finish_rollout(self, run: Run, rollout: Rollout) -> dict[str, Tensor] | None:
        """Return the bonus as a stream with its own critic, (T, n)."""
        looked = self._look(rollout)
        self.looked = looked
        bonus = self.curiosity.bonus(looked.inputs)
        looked.bonus = float(bonus.mean())
        return {STREAM: self.curiosity.normalized(bonus, rollout.done)}

    @hookimpl
    def combine_advantages(self, run: Run, rollout: Rollout, streams: dict[str, Tensor]) -> Tensor | None:
        """norm(Â_α) − w · norm(Â_ν) + β · norm(Â_c), each normalised over the rollout, (T, n)."""
        assert self.looked is not None
        return (
            normalize_advantages(streams["reward"])
            - self.options.victim_weight * normalize_advantages(self.looked.victim_advantages)
            + self.options.curiosity_weight * normalize_advantages(streams[STREAM])
        )

    @hookimpl
    def update_auxiliary(self, run: Run, rollout: Rollout) -> dict[str, float] | None:
        """Train the predictor and the surrogate on this rollout, then update the statistics with it."""
        looked, self.looked = self.looked, None
        assert looked is not None
        parts = run.config.ppo.minibatches
        metrics = {
            "bonus": looked.bonus,
            "victim_value": float(looked.values.mean()),
            "explained_variance": explained_variance(looked.values, looked.returns),
            "predictor_loss": self.curiosity.learn(looked.inputs.flatten(0, 1), parts, run.generator),
            "surrogate_loss": self.surrogate.learn(
                looked.states.flatten(0, 1), looked.returns.flatten(), parts, run.generator
            ),
        }
        if not looked.fresh:
            self._take_in(rollout)
        return metrics

    def _look(self, rollout: Rollout) -> Looked:
        """Compute values, hidden layer and inputs of the random networks, with the present weights."""
        fresh = any(bool(normalizer.moments.count == 0) for normalizer in self.sights.values())
        if fresh:  # the first rollout was played without statistics
            self._take_in(rollout)
        observes, watched = self.options.surrogate.observes, self.options.curiosity.input
        states = self.sights[observes](_seen(observes, rollout.observation, rollout.victim_observation))
        last = self.sights[observes](
            _seen(observes, rollout.next_observation, rollout.next_victim_observation)
        )
        hidden, values = self.surrogate.look(states)
        _, next_value = self.surrogate.look(last)
        if watched == "surrogate":
            inputs = hidden
        elif watched == observes:
            inputs = states
        else:
            inputs = self.sights[watched](_seen(watched, rollout.observation, rollout.victim_observation))
        return Looked(states, inputs, values, fresh, self._victim_advantages(rollout, values, next_value))

    def _victim_advantages(self, rollout: Rollout, values: Tensor, next_value: Tensor) -> Tensor:
        """GAE of r^ν against the surrogate's values (T, n) and (n,); (T, n)."""
        ppo = self.setup.ppo
        return gae(
            rollout.normalized_victim_reward,
            values,
            next_value,
            rollout.done,
            gamma=ppo.gamma,
            lam=ppo.lam,
        )

    def _take_in(self, rollout: Rollout) -> None:
        for sight, normalizer in self.sights.items():
            seen = _seen(sight, rollout.observation, rollout.victim_observation)
            normalizer.update(seen.flatten(0, 1))

    def _size(self, sight: str) -> int:
        adversary, victim = self.setup.adversary.observation_size, self.setup.victim.observation_size
        return {"adversary": adversary, "victim": victim, "both": adversary + victim}[sight]

    def state_dict(self) -> dict[str, Any]:
        """See :meth:`apil_core.Method.state_dict`."""
        return {
            "sights": {sight: normalizer.state_dict() for sight, normalizer in self.sights.items()},
            "surrogate": self.surrogate.training_state(),
            "curiosity": self.curiosity.training_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :meth:`apil_core.Method.load_state_dict`."""
        for sight, normalizer in self.sights.items():
            normalizer.load_state_dict(state["sights"][sight])
        self.surrogate.load_training_state(state["surrogate"])
        self.curiosity.load_training_state(state["curiosity"])


def _seen(sight: str, observation: Tensor, victim_observation: Tensor) -> Tensor:
    if sight == "adversary":
        return observation
    if sight == "victim":
        return victim_observation
    return torch.cat([observation, victim_observation], dim=-1)


def explained_variance(values: Tensor, returns: Tensor) -> float:
    """1 − Var(returns − values) / Var(returns); 0 where the returns do not vary."""
    spread = returns.var()
    return float(1 - (returns - values).var() / spread) if float(spread) > 0 else 0.0

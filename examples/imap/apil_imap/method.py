"""IMAP's hooks: an intrinsic reward stream with its own critic, and its weight in the advantage."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from apil_core import (
    DiagonalGaussian,
    Method,
    MethodSetup,
    PluginError,
    ReturnNormalizer,
    Rollout,
    Run,
    StepBatch,
    hookimpl,
    normalize_advantages,
)
from apil_imap.config import ImapConfig
from apil_imap.density import Reservoir, neighbour_distance
from apil_imap.features import Features
from apil_imap.mimic import Mimic
from apil_imap.risk import closeness, openings
from apil_imap.weighting import BiasReduction

STREAM = "intrinsic"
"""Name of the reward stream."""


class Imap(Method):
    """max J_E + τ_k J_I (Zheng et al. 2024): J_E is the game's reward, J_I one of four intrinsic objectives.

    Each rollout: estimate the bonus, scale it by its return's standard deviation, move λ by how the
    objective did, mix both advantages, and only then let the mimic follow.
    """

    options: ImapConfig

    def __init__(self, options: ImapConfig, setup: MethodSetup):
        super().__init__(options, setup)
        device, bonus = setup.device, options.bonus
        coverage = {"adversary": 1 - options.xi, "victim": options.xi}
        only = {"risk": {"victim": 1.0}, "divergence": {"adversary": 1.0}}
        seats = {"adversary": setup.adversary, "victim": setup.victim}
        self.weights = {side: weight for side, weight in only.get(bonus, coverage).items() if weight > 0}
        projection = 0 if bonus in only else options.projection
        self.features = {
            side: Features(seats[side].observation_size, projection).to(device) for side in self.weights
        }
        self.reservoir = Reservoir(options.references)
        self.weighting = BiasReduction(options)
        self.mimic: Mimic | None = None
        if bonus == "divergence":
            sizes = setup.adversary.observation_size, setup.adversary.action_size
            unit = setup.adversary.action_limit if setup.ppo.action_unit == "limit" else 1.0
            self.mimic = Mimic(*sizes, options.mimic, unit * setup.ppo.init_std).to(device)
        self.scale: ReturnNormalizer | None = None
        self._opening: Tensor | None = None
        self._won = torch.zeros((), dtype=torch.long, device=device)
        self._ended = torch.zeros((), dtype=torch.long, device=device)
        self._metrics: dict[str, float] = {}

    @hookimpl
    def shape_reward(self, run: Run, step: StepBatch) -> None:
        """Count games won and ended; add nothing to the reward."""
        self._won += ((step.outcome == 1) & step.done).sum()
        self._ended += step.done.sum()

    @hookimpl
    def finish_rollout(self, run: Run, rollout: Rollout) -> dict[str, Tensor]:
        """Bonus of every step, (T, n), in units of the standard deviation of its discounted return."""
        with torch.no_grad():
            bonus = self._bonus(run, rollout)
            scaled = self._scaled(bonus, rollout.done)
        objective = self._objective(rollout)
        if objective is not None:
            self.weighting.update(objective)
        self._metrics = {"bonus": float(bonus.mean()), "bonus_std": float(bonus.std())}
        return {STREAM: scaled}

    @hookimpl
    def combine_advantages(self, run: Run, rollout: Rollout, streams: dict[str, Tensor]) -> Tensor:
        """Â_E + τ_k Â_I, (T, n), normalised over the rollout; by the options each of them before, too."""
        extrinsic, intrinsic = streams["reward"], streams[STREAM]
        if self.options.normalize == "advantages":
            extrinsic, intrinsic = normalize_advantages(extrinsic), normalize_advantages(intrinsic)
        return normalize_advantages(extrinsic + self.weighting.weight * intrinsic)

    @hookimpl
    def update_auxiliary(self, run: Run, rollout: Rollout) -> dict[str, float]:
        """Train the mimic, if there is one; log bonus, objective, λ and τ_k."""
        weighting = self.weighting
        metrics = {
            **self._metrics,
            "objective": weighting.last or 0.0,
            "multiplier": float(weighting.multiplier),
            "temperature": weighting.weight,
        }
        if self.mimic is not None:
            acted = _distribution(rollout)
            flat = DiagonalGaussian(acted.mean.flatten(0, 1), acted.std.flatten(0, 1))
            states = self.features["adversary"].normalize(rollout.observation.flatten(0, 1))
            metrics["mimic_kl"] = self.mimic.learn(flat, states, run.generator)
        return metrics

    def _bonus(self, run: Run, rollout: Rollout) -> Tensor:
        """The intrinsic reward, unscaled, (T, n); updates the statistics it is measured with."""
        observations = {"adversary": rollout.observation, "victim": rollout.victim_observation}
        for side, features in self.features.items():
            features.update(observations[side])
        if self.options.bonus == "risk":
            return self._risk(rollout)
        if self.mimic is not None:
            states = self.features["adversary"].normalize(rollout.observation)
            return self.mimic.divergence(_distribution(rollout), states)
        points = {
            side: features(observations[side]).flatten(0, 1) for side, features in self.features.items()
        }
        return self._coverage(points, run.generator).view(rollout.done.shape)

    def _coverage(self, points: dict[str, Tensor], generator: torch.Generator) -> Tensor:
        """Rarity of each state, (T·n,): among this rollout's states, or among those of all rollouts."""
        options = self.options
        if options.bonus == "state_coverage":
            self.reservoir.clear()
        own = self.reservoir.offer(torch.cat(list(points.values()), dim=1), generator)
        assert self.reservoir.states is not None
        sizes = [states.shape[1] for states in points.values()]
        references = torch.split(self.reservoir.states, sizes, dim=1)
        total = torch.zeros((), device=own.device)
        for (side, states), known in zip(points.items(), references, strict=True):
            distance = neighbour_distance(states, known.contiguous(), options.neighbours, own)
            rarity = distance.log1p() if options.distance == "log" else distance
            total = total + self.weights[side] * rarity
        return total

    def _risk(self, rollout: Rollout) -> Tensor:
        """Minus the distance of the victim's state to the first one of its game, (T, n)."""
        observations, features = rollout.victim_observation, self.features["victim"]
        carried = self._opening
        if carried is not None and carried.shape != observations[0].shape:
            carried = None  # from a run with another number of games, which all restart
        targets = openings(observations, rollout.first, carried)
        self._opening = targets[-1].clone()
        return closeness(features.normalize(observations), features.normalize(targets))

    def _scaled(self, bonus: Tensor, done: Tensor) -> Tensor:
        """``bonus`` (T, n) divided by the running standard deviation of its discounted return."""
        if self.scale is None or len(self.scale.returns) != bonus.shape[1]:
            fresh = ReturnNormalizer(bonus.shape[1], self.setup.ppo.gamma, clip=float("inf"))
            if self.scale is not None:
                fresh.moments.load_state_dict(self.scale.moments.state_dict())
            self.scale = fresh.to(bonus.device)
        for reward, ended in zip(bonus, done, strict=True):
            self.scale.update(reward, ended)
        scaled: Tensor = self.scale(bonus)
        return scaled

    def _objective(self, rollout: Rollout) -> float | None:
        """J_E: the mean reward, or the win rate; ``None`` until enough games have ended."""
        if self.options.objective == "reward":
            return float(rollout.reward.mean())
        won, ended = int(self._won), int(self._ended)
        if ended < self.options.min_games:
            return None
        self._won.zero_()
        self._ended.zero_()
        return won / ended

    def state_dict(self) -> dict[str, Any]:
        """Return statistics, sample, λ, mimic, and the first states of the running games."""
        state: dict[str, Any] = {
            "features": {side: features.state_dict() for side, features in self.features.items()},
            "reservoir": self.reservoir.state_dict() if self.options.bonus == "policy_coverage" else {},
            "weighting": self.weighting.training_state(),
            "scale": None if self.scale is None else self.scale.state_dict(),
            "mimic": None if self.mimic is None else self.mimic.training_state(),
            "opening": self._opening,
            "games": {"won": self._won.clone(), "ended": self._ended.clone()},
        }
        return state

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`state_dict` returned."""
        device = self.setup.device
        for side, features in self.features.items():
            features.load_state_dict(state["features"][side])
        self.reservoir.load_state_dict(state["reservoir"], device)
        self.weighting.load_training_state(state["weighting"])
        if state["scale"] is not None:
            games = len(state["scale"]["returns"])
            self.scale = ReturnNormalizer(games, self.setup.ppo.gamma, clip=float("inf")).to(device)
            self.scale.load_state_dict(state["scale"])
        if self.mimic is not None:
            self.mimic.load_training_state(state["mimic"])
        self._opening = None if state["opening"] is None else state["opening"].to(device)
        self._won.copy_(state["games"]["won"])
        self._ended.copy_(state["games"]["ended"])


def _distribution(rollout: Rollout) -> DiagonalGaussian:
    """Distribution from which the adversary's actions were drawn, (T, n, a)."""
    if rollout.action_mean is None or rollout.action_std is None:
        raise PluginError("the divergence bonus needs rollouts of the adversary's own games")
    return DiagonalGaussian(rollout.action_mean, rollout.action_std)

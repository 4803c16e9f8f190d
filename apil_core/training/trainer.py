"""The training loop: collect, estimate advantages, let methods learn, update PPO."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import torch
from torch import Tensor

from apil_core.api.method import Observer, RunPlugin
from apil_core.api.policy import Policy
from apil_core.api.types import Rollout
from apil_core.common.errors import PluginError
from apil_core.common.machine import usable_cpus
from apil_core.common.torch_threads import side_by_side
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import short_repr
from apil_core.training.build import RunParts
from apil_core.training.distributed.replicas import Replicas
from apil_core.training.plugin_state import load_known_states, load_states, of_other_games, states_of
from apil_core.training.ppo import MAIN_STREAM
from apil_core.training.side_games import SideGames
from apil_core.training.storage.metrics_log import over_processes
from apil_core.training.white_box import VictimInside


class Trainer:
    """One run in memory; this is the ``run`` that hooks get.

    Attributes are those of :class:`apil_core.Run`.

    Args:
        attack: the assembled parts.
        plugins: for building side games.
    """

    def __init__(self, attack: RunParts, plugins: PluginRegistry):
        self.attack = attack
        self.plugins = plugins
        self.config = attack.config
        self.layout = attack.game.layout
        self.adversary_side = attack.adversary_side
        self.device = attack.env.device
        self.generator = attack.generators["method"]
        self.total_steps = attack.config.steps
        self.iteration = 0
        self.hook = attack.hooks.hook
        self.wall_seconds = 0.0
        self.stopped = ""
        self._begun_at = 0
        self._beside_ppo = False
        self.side_games = SideGames(attack, plugins)
        self.world = attack.world
        own = [] if attack.env.privileged is None else [attack.env.privileged]
        statistics = [attack.builder.normalizers, *attack.env.normalizers.values(), *own]
        self._replicas = Replicas(attack.world, attack.hooks.of(RunPlugin), statistics)
        self._relabelling = attack.hooks.callers("relabel_reward")
        attack.env.relabels = bool(self._relabelling)
        attack.env.played = lambda: self.steps
        attack.env.shape_reward = partial(self.hook.shape_reward, run=self)

    @property
    def steps(self) -> int:
        """Environment steps so far, side games and those of other processes included."""
        return (self.attack.env.steps + self.side_games.steps) * self.world.size

    @property
    def finished(self) -> bool:
        """True if the budget is used up."""
        return self.steps >= self.total_steps

    def iterate(self, *, actor_fixed: bool = False) -> dict[str, float]:
        """Run one iteration; returns its metrics.

        Args:
            actor_fixed: train everything except the adversary's policy.
        """
        begin = time.perf_counter()
        self._begun_at = self.steps
        with self.attack.hooks.attribution():
            self._collect()
            collected = time.perf_counter()
            rollout = self.attack.env.finish_rollout()
            metrics = self._learn(rollout, actor_fixed)
            self._replicas.agree(self.steps)
        end = time.perf_counter()
        self.iteration += 1
        self.wall_seconds += end - begin
        metrics.update(self.attack.env.stats.metrics())
        if self.world.size > 1:
            metrics = over_processes(self.world.gather(metrics))
        metrics.update(
            iteration=self.iteration,
            steps=self.steps,
            total_steps=self.total_steps,
            wall_seconds=self.wall_seconds,
            steps_per_second=(self.steps - self._begun_at) / (end - begin),
            collect_seconds=collected - begin,
            update_seconds=end - collected,
        )
        return metrics

    def start_equal(self) -> None:
        """Copy the first process's networks to all, before the first iteration."""
        self.attack.learner.start_equal()
        self._replicas.start_equal()

    def _collect(self) -> None:
        env, learner = self.attack.env, self.attack.learner
        with torch.inference_mode():
            observations = env.get_observations()
            for _ in range(self.config.ppo.num_steps):
                actions = learner.act(observations)
                observations, _, done, _ = env.step(actions)
                learner.ended(done)

    def _learn(self, rollout: Rollout, actor_fixed: bool) -> dict[str, float]:
        hooks, learner = self.attack.hooks, self.attack.learner
        acted = learner.distribution()
        rollout.action_mean, rollout.action_std = acted.mean, acted.std
        relabelled = self._relabel(rollout)
        streams = self._streams(rollout)
        advantages = learner.advantages(self.attack.env.get_observations(), streams)
        mixed = hooks.hook.combine_advantages(run=self, rollout=rollout, streams=advantages)
        if mixed is not None:
            mixed = hooks.checked("combine_advantages", "", mixed, tuple(rollout.done.shape))
        rollout.advantages = advantages[MAIN_STREAM] if mixed is None else mixed
        update = partial(
            learner.update,
            rollout.advantages,
            as_given=mixed is not None,
            learning_rate=self._learning_rate(),
            actor_fixed=actor_fixed,
        )
        return relabelled | self._update(rollout, update)

    def _relabel(self, rollout: Rollout) -> dict[str, float]:
        """Let plugins replace the main reward, one after the other; returns its mean as a metric."""
        if not self._relabelling:
            return {}
        hooks, reward = self.attack.hooks, rollout.shaped_reward
        for name, ask in self._relabelling.items():
            for answer in ask(run=self, rollout=rollout, reward=reward, **_successors(rollout)):
                shape = tuple(rollout.done.shape)
                reward = hooks.checked("relabel_reward", "", answer, shape, by=name)
        mean = float(reward.mean())  # before it may be normalised in place
        self.attack.env.relabel(rollout, reward)
        return {"reward/relabelled": mean}

    def _update(self, rollout: Rollout, ppo: Callable[[], dict[str, float]]) -> dict[str, float]:
        """Update auxiliary models and PPO; functions returned by plugins run in parallel with PPO's update.

        PPO's update changes only torch's global generator and the adversary's networks, and such a function
        may use neither: the result is the same bit for bit in parallel and in sequence.
        """
        hooks = self.attack.hooks
        metrics: dict[str, float] = {}
        later: dict[str, Callable[[], Any]] = {}
        for name, plugin in hooks.plugins.items():
            for answer in hooks.only(plugin).update_auxiliary(
                run=self, rollout=rollout, **_successors(rollout)
            ):
                if callable(answer):
                    later[name] = answer
                else:
                    metrics |= _named(name, hooks.merged([answer], "update_auxiliary"))

        def auxiliary() -> dict[str, float]:
            done: dict[str, float] = {}
            for name, work in later.items():
                done |= _named(name, hooks.finished(name, work, rollout))
            return done

        self._beside_ppo = True
        try:
            for part in side_by_side(auxiliary, ppo, apart=bool(later) and self._has_cores):
                metrics |= part
        finally:
            self._beside_ppo = False
        return metrics

    @property
    def _has_cores(self) -> bool:
        """True if this process has a second core; False with a GPU, whose queue is sequential anyway."""
        threads = self.world.threads(self.config.threads) or usable_cpus()
        return self.device.type == "cpu" and min(threads, usable_cpus()) > 1

    def _streams(self, rollout: Rollout) -> dict[str, Tensor]:
        """Further reward streams, checked: a stream left out once would train its critic on old targets."""
        hooks, critics = self.attack.hooks, self.attack.learner.critics
        answers = hooks.hook.finish_rollout(run=self, rollout=rollout, **_successors(rollout))
        streams = hooks.merged(answers, "finish_rollout")
        if MAIN_STREAM in streams:
            raise hooks.plugin_error("finish_rollout", f"the name {MAIN_STREAM!r} is taken; choose another")
        if not self.iteration:  # they may be those of the run it was initialised from
            for name in critics.keys() - streams.keys():
                del critics[name]
        elif critics and streams.keys() != critics.keys():
            text = f"streams changed from {sorted(critics)} to {sorted(streams)}"
            raise hooks.plugin_error("finish_rollout", text)
        shape = tuple(rollout.done.shape)
        return {name: hooks.checked("finish_rollout", name, v, shape) for name, v in streams.items()}

    def _learning_rate(self) -> float:
        ppo = self.config.ppo
        if ppo.lr_schedule == "constant":
            return ppo.learning_rate
        # as in the published code: the share of the budget left at the start of the iteration
        return ppo.learning_rate * max(1.0 - self._begun_at / self.total_steps, 0.0)

    @property
    def victim(self) -> VictimInside:
        """See :attr:`apil_core.Run.victim`."""
        if not self.attack.hooks.white_box:
            text = f"method {self.config.method!r} may not see inside the victim"
            raise PluginError(f"run.victim: {text}; if it should, state white_box=True in its MethodSpec")
        return VictimInside(self.attack.env)

    def stop(self, reason: str = "asked by a hook") -> None:
        """See :meth:`apil_core.Run.stop`."""
        self.stopped = self.stopped or reason

    def collect(self, victim_side_policy: Policy, steps: int) -> Rollout:
        """See :meth:`apil_core.Run.collect`."""
        if self._beside_ppo:
            text = "run.collect: the adversary is being updated; call it before update_auxiliary returns"
            raise PluginError(text)
        return self.side_games.collect(victim_side_policy, steps)

    def policy_state(self) -> dict[str, Any]:
        """The part of :meth:`state_dict` that determines the adversary."""
        attack = self.attack
        return {
            "groups": attack.builder.sizes,
            "builder": attack.builder.state_dict(),
            "learner": attack.learner.state_dict(),
            "methods": states_of(attack.methods),
            "observers": states_of(attack.hooks.of(Observer)),
        }

    def state_dict(self) -> dict[str, Any]:
        """The whole run at an iteration boundary."""
        attack = self.attack
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "wall_seconds": self.wall_seconds,
            "processes": self.world.size,
            **self.policy_state(),
            "env": attack.env.state_dict(),
            "side_games": self.side_games.state_dict(),
            "generators": {name: g.get_state() for name, g in attack.generators.items()},
            "torch_rng": torch.get_rng_state(),
            "cuda_rng": torch.cuda.get_rng_state(self.device) if self.device.type == "cuda" else None,
            "config": self.config.model_dump(mode="json"),
        }

    def close(self) -> None:
        """Release the games."""
        self.attack.game.close()
        self.side_games.close()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where :meth:`state_dict` was taken."""
        attack = self.attack
        self.iteration = state["iteration"]
        self.wall_seconds = state["wall_seconds"]
        attack.builder.load_state_dict(state["builder"])
        attack.learner.load_state_dict(state["learner"])
        load_states(attack.methods, state["methods"])
        load_states(attack.hooks.of(Observer), state.get("observers", {}))  # older ones lack the key
        attack.env.load_state_dict(state["env"])
        self.side_games.load_state_dict(state["side_games"])
        for name, generator in attack.generators.items():
            generator.set_state(state["generators"][name].cpu())
        torch.set_rng_state(state["torch_rng"].cpu())
        if state["cuda_rng"] is not None:
            torch.cuda.set_rng_state(state["cuda_rng"].cpu(), self.device)

    def start_from(self, state: dict[str, Any]) -> None:
        """Take networks and statistics of another run's state; games and PPO's optimisers start fresh.

        So does what a plugin keeps for each game, where there were more or fewer of them.

        Reward statistics come along, since the critics predict in their units.
        """
        attack = self.attack
        attack.builder.load_state_dict(state["builder"])
        attack.learner.load_networks(state["learner"])
        for name, module in attack.env.normalizers.items():
            saved = state["env"]["normalizers"][name]
            moments = {
                key.removeprefix("moments."): v for key, v in saved.items() if key.startswith("moments.")
            }
            module.moments.load_state_dict(moments)
        privileged = state["env"].get("privileged")
        if attack.env.privileged is not None and privileged is not None:
            attack.env.privileged.load_state_dict(privileged)
        attack.env.restart()
        there, here = state["config"]["num_envs"], self.config.num_envs
        for plugins, key in ((attack.methods, "methods"), (attack.hooks.of(Observer), "observers")):
            fresh = states_of(plugins)
            load_known_states(plugins, of_other_games(state.get(key, {}), fresh, there, here))


def _successors(rollout: Rollout) -> dict[str, Tensor | None]:
    """Arguments of hooks that may ask for the observations after each step."""
    return {"successors": rollout.successors, "victim_successors": rollout.victim_successors}


def _named(plugin: str, answer: Mapping[str, Any]) -> dict[str, float]:
    """A plugin's metrics as they are logged.

    Raises:
        PluginError: one is no number.
    """
    metrics = {}
    for key, value in answer.items():
        try:
            metrics[f"{plugin}/{key}"] = float(value)
        except (TypeError, ValueError) as error:
            text = f"update_auxiliary: {key!r} must be a number, got {short_repr(value)}"
            raise PluginError(f"plugin {plugin!r}: {text}") from error
    return metrics

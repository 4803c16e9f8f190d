"""A run's adversary as a policy: ``run:DIR`` (its newest checkpoint) or ``run:DIR/checkpoints/FILE.pt``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch

from apil_core.api.config import RunConfig
from apil_core.api.game import GameLayout, SideLayout
from apil_core.api.policy import Policy, PolicyInfo
from apil_core.common.errors import ConfigError, RunDirError
from apil_core.common.files import sha256
from apil_core.config.absent import completed
from apil_core.config.kind import is_retraining
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.plugins.registry import layout_of
from apil_core.policies.loading import victim_side
from apil_core.training.adversary import AdversaryPolicy
from apil_core.training.build import adversary_policy
from apil_core.training.storage import checkpoint
from apil_core.training.storage.checkpoint import check_same_policy, fitting
from apil_core.training.storage.run_dir import RunDir

SCHEME = "run:"


def run_path(name: Path | str) -> Path | None:
    """The run's directory (or checkpoint) behind ``run:PATH`` or a bare directory; else ``None``.

    A retraining's directory is not a run's.
    """
    text = str(name)
    if text.startswith(SCHEME):
        return Path(text.removeprefix(SCHEME))
    return Path(text) if Path(text).is_dir() and not is_retraining(Path(text)) else None


@dataclass(frozen=True)
class RunCheckpoint:
    """A run and one of its checkpoints.

    Attributes:
        run_dir: the run.
        path: of the checkpoint, absolute.
    """

    run_dir: RunDir
    path: Path

    @classmethod
    def find(cls, path: Path, checkpoint_path: Path | None = None) -> RunCheckpoint:
        """From a run's directory or one of its checkpoints.

        Args:
            path: of the directory or the checkpoint.
            checkpoint_path: a checkpoint of the directory, or ``best``; default: its newest.

        Raises:
            RunDirError: there is no run, or no such checkpoint.
        """
        path = path.expanduser()
        if path.suffix != ".pt":
            run_dir = RunDir(path)
            run_dir.config()  # its error is clearer where there is no run
            return cls(run_dir, run_dir.checkpoint(checkpoint_path).absolute())
        if not path.is_file():
            raise RunDirError(
                f"there is no checkpoint {path}: a run keeps its newest ones only (checkpoint.keep); "
                f"to keep an adversary for good: apil export {path.parent.parent} --format safetensors"
            )
        return cls(RunDir(path.parent.parent), path.absolute())

    def policy(
        self, config: RunConfig, layout: GameLayout, plugins: PluginRegistry, seed: int, name: str
    ) -> tuple[AdversaryPolicy, int]:
        """The adversary, on ``config.device``, and the number of steps it was trained for.

        Args:
            config: the run's, possibly on another device.
            layout: of its game.
            plugins: registry with its method.
            seed: of the generator its stochastic hooks draw from.
            name: of the policy.

        Raises:
            RunDirError: the checkpoint is damaged, or of another run.
        """
        state = checkpoint.read(self.path)
        check_same_policy(state, config, plugins, self.path)
        side = 1 - victim_side(config, plugins)
        seat = layout.sides[side]
        info = PolicyInfo(
            name,
            sha256(self.path),
            seat.observation_size,
            seat.action_size,
            provenance={"run": str(self.run_dir.path), "game": config.env, "side": seat.name},
            action_bounds=(seat.action_low, seat.action_high),
        )
        # initial weights are drawn and discarded; the caller's random stream must not change
        with torch.random.fork_rng(devices=[]), fitting(self.path):
            policy = adversary_policy(state, info, config, layout, side, plugins, seed)
        return policy, int(state["steps"])


def load(name: str, *, seat: SideLayout | None, plugins: PluginRegistry, device: str) -> Policy:
    """The adversary of a run as any other policy, for the seat it was trained in.

    Args:
        name: directory of the run, or one of its checkpoints.
        seat: of the policy.
        plugins: registry with its method, unless the run names one-file plugins: those are loaded.
        device: of the networks.

    Raises:
        ApilError: there is no such run, or it was trained for another seat.
    """
    source = RunCheckpoint.find(Path(name))
    config = source.run_dir.config().model_copy(update={"device": device})
    plugins = discover(config.plugins) if config.plugins else plugins
    config = completed(config, plugins)
    layout = layout_of(config.env, config.game, plugins)
    trained = layout.sides[1 - victim_side(config, plugins)]
    if seat not in (None, trained):
        assert seat is not None
        other = f"the {seat.name}" if seat.name != trained.name else f"another {seat.name}"
        raise ConfigError(f"{name} trained the {trained.name} of {config.env}; it cannot be {other}")
    policy, _ = source.policy(config, layout, plugins, 0, f"{SCHEME}{source.path}")
    if policy.hooks.implements("filter_observation"):
        raise ConfigError(f"{name} filters what both sides see; it can only play as the adversary")
    return policy

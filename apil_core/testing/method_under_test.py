"""The method under test, with its plugins, and short runs of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from apil_core.api.config import RunConfig
from apil_core.api.specs import MethodSpec, load
from apil_core.common.errors import UnknownNameError
from apil_core.config.resolve import complete
from apil_core.evaluation.progress import Progress
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.runs.session import Session
from apil_core.testing.checks import METHOD_CHECKS, Subject
from apil_core.testing.registry import registry_of
from apil_core.testing.tiny import tiny_config
from apil_core.training.build import build
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir
from apil_core.training.trainer import Trainer

SHORT = 5
"""Steps of a game in tiny runs, where the game has that option: some must end and restart."""


@dataclass
class MethodUnderTest(Subject):
    """A method under test.

    Attributes:
        env: the game it is tried on.
        options: of the method, as under ``options.<name>``; ``None``: the defaults.
        registry: a registry of its own, with the method in it.
    """

    kind = "method"
    checks = METHOD_CHECKS

    env: str
    options: Mapping[str, Any] | None
    registry: PluginRegistry = field(default_factory=PluginRegistry)

    @property
    def spec(self) -> MethodSpec:
        """Its spec."""
        return self.registry.methods[self.name]

    def config(self, **changes: Any) -> RunConfig:
        """A run of the method: 6 games, 4 rollouts of 8 steps, all checkpoints kept."""
        spec = self.registry.game(self.env)
        shortened = spec.config is not None and "max_steps" in load(spec.config).model_fields
        base: dict[str, Any] = {
            "method": self.name,
            "env": self.env,
            "steps": 4 * 48,
            "num_envs": 6,
            "threads": 1,
            "ppo": {"num_steps": 8, "epochs": 2, "minibatches": 2},
            "checkpoint": {"every_iterations": 1, "keep": 100},
            "game": {"max_steps": SHORT} if shortened else {},
            "options": {} if self.options is None else {self.name: dict(self.options)},
        }
        return tiny_config(**{**base, **changes})


def find(
    method: MethodSpec | str,
    plugins: Sequence[str | Path],
    options: Mapping[str, Any] | None,
    env: str,
) -> MethodUnderTest:
    """Find the method among all installed plugins and the files given.

    Raises:
        ContractError: its plugin is broken.
        UnknownNameError: no method or no game has that name.
    """
    tested = MethodUnderTest(method if isinstance(method, str) else method.name, env, options)
    with tested.check("spec", UnknownNameError):
        tested.registry = registry_of(tested, method, plugins)
    tested.registry.game(env)
    return tested


def train(
    tested: MethodUnderTest,
    config: RunConfig,
    out: Path,
    *,
    manager: type[RunHookManager] = RunHookManager,
    checkpoint_path: Path | None = None,
) -> Trainer:
    """Run ``config`` from its start, or from a checkpoint of another run of it.

    As :func:`apil_core.run` and :func:`apil_core.resume` do, but with the tested's registry.

    Args:
        tested: the method.
        config: of the run.
        out: its directory.
        manager: of its hooks.
        checkpoint_path: start from here.
    """
    registry = tested.registry
    config = complete(config, registry).model_copy(update={"victim_sha256": ""})
    trainer = Trainer(build(config, registry, manager=manager), registry)
    pending: Sequence[dict[str, float]] = ()
    if checkpoint_path is not None:
        state = checkpoint.read(checkpoint_path)
        trainer.load_state_dict(state)
        pending = state.get("pending_rows", ())
    run_dir = RunDir.create(trainer.config, out, (), registry)
    Session(trainer, run_dir, Progress(), registry, pending).run()
    return trainer


def final_state(out: Path) -> dict[str, Any]:
    """Read a run's newest checkpoint."""
    return checkpoint.read(RunDir(out).newest_checkpoint())

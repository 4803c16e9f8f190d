"""The method under test, with its plugins, and short runs of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from apil_core.api.config import RunConfig
from apil_core.api.specs import MethodSpec, load
from apil_core.common.errors import PluginError, UnknownNameError
from apil_core.config.resolve import complete
from apil_core.evaluation.progress import Progress
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.runs.session import Session
from apil_core.testing.checks import METHOD_CHECKS, Check, ContractError, reported_as
from apil_core.testing.tiny import tiny_config
from apil_core.training.build import build
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir
from apil_core.training.trainer import Trainer

SHORT = 5
"""Steps of a game in tiny runs, where the game has that option: some must end and restart."""


@dataclass
class MethodUnderTest:
    """A method under test.

    Attributes:
        spec: its spec.
        registry: a registry of its own, with the method in it.
        options: of the method, as under ``options.<name>``; ``None``: the defaults.
        env: the game it is tried on.
    """

    spec: MethodSpec
    registry: PluginRegistry
    env: str
    options: Mapping[str, Any] | None = None
    skipped: list[str] = field(default_factory=list)

    @property
    def who(self) -> str:
        """Name for messages."""
        return f"method {self.spec.name!r}"

    def broken(self, check: str, happened: str, hook: str | None = None) -> ContractError:
        """Make the error for one of :data:`METHOD_CHECKS`."""
        return ContractError(self.who, METHOD_CHECKS[check], happened, hook)

    def config(self, **changes: Any) -> RunConfig:
        """A run of the method: 6 games, 4 rollouts of 8 steps, all checkpoints kept."""
        spec = self.registry.game(self.env)
        shortened = spec.config is not None and "max_steps" in load(spec.config).model_fields
        base: dict[str, Any] = {
            "method": self.spec.name,
            "env": self.env,
            "steps": 4 * 48,
            "num_envs": 6,
            "threads": 1,
            "ppo": {"num_steps": 8, "epochs": 2, "minibatches": 2},
            "checkpoint": {"every_iterations": 1, "keep": 100},
            "game": {"max_steps": SHORT} if shortened else {},
            "options": {} if self.options is None else {self.spec.name: dict(self.options)},
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
    name = method.name if isinstance(method, MethodSpec) else method
    registry = registry_with(f"method {name!r}", METHOD_CHECKS["spec"], plugins)
    if isinstance(method, MethodSpec):
        registry.methods[name] = method
    elif name not in registry.methods:
        raise_if_broken(f"method {name!r}", METHOD_CHECKS["spec"], registry, name)
        raise UnknownNameError("method", name, registry.methods)
    registry.game(env)
    return MethodUnderTest(registry.methods[name], registry, env, options)


def registry_with(who: str, check: Check, plugins: Sequence[str | Path]) -> PluginRegistry:
    """Make a separate registry, so that what is added to it does not affect others.

    Raises:
        ContractError: one of the files is broken.
    """
    try:
        return discover(plugins)
    except PluginError as error:
        raise ContractError(who, check, str(error)) from error


def raise_if_broken(who: str, check: Check, registry: PluginRegistry, name: str) -> None:
    """If a plugin that was left out may offer the unknown name, raise the reason it was left out."""
    for record in registry.records:
        if record.error is not None and record.name == name:
            text = f"plugin {record.name!r} ({record.origin}) is broken: {record.error}"
            raise ContractError(who, check, text)


def train(
    tested: MethodUnderTest,
    config: RunConfig,
    out: Path,
    *,
    check: str = "run",
    manager: type[RunHookManager] = RunHookManager,
    checkpoint_path: Path | None = None,
) -> Trainer:
    """Run ``config`` from its start, or from a checkpoint of another run of it.

    As :func:`apil_core.run` and :func:`apil_core.resume` do, but with the tested's registry.

    Args:
        tested: the method.
        config: of the run.
        out: its directory.
        check: that is broken if something goes wrong.
        manager: of its hooks.
        checkpoint_path: start from here.

    Raises:
        ContractError: the method failed.
    """
    registry = tested.registry
    with reported_as(tested.who, METHOD_CHECKS[check]):
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

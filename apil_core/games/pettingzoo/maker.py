"""Construction of environments from ``module:callable``, in this process and in workers."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import packages_distributions
from operator import attrgetter
from pathlib import Path
from typing import Any

from pettingzoo import AECEnv, ParallelEnv

from apil_core.common.errors import ConfigError, failures, reason_of
from apil_core.plugins.discovery import import_file


@dataclass(frozen=True)
class Maker:
    """Makes one environment per call.

    Attributes:
        target: ``"module:callable"``.
        kwargs: of the callable.
        file: the module was loaded from, by which a worker that was not forked finds a one-file plugin.
    """

    target: str
    kwargs: dict[str, Any] = field(default_factory=dict)
    file: str | None = None

    @classmethod
    def find(cls, target: str, kwargs: dict[str, Any]) -> Maker:
        """Import the module and find the callable.

        Raises:
            ConfigError: there is no such thing, or it is not callable.
        """
        module, _, attribute = target.partition(":")
        if not module or not attribute:
            raise ConfigError(f"game pettingzoo:{target}: expected pettingzoo:MODULE:CALLABLE")
        try:
            found = cls(target).callable
        except failures() as error:
            raise ConfigError(f"game pettingzoo:{target}: cannot be loaded: {reason_of(error)}") from error
        if not callable(found):
            raise ConfigError(f"game pettingzoo:{target}: {attribute} is not callable")
        return cls(target, kwargs, getattr(sys.modules[module], "__file__", None))

    @property
    def callable(self) -> Any:
        """The callable that the target names; imports its module."""
        module, _, attribute = self.target.partition(":")
        with prints_to_stderr():
            if module in sys.modules or self.file is None or importlib.util.find_spec(module):
                return attrgetter(attribute)(importlib.import_module(module))
            return attrgetter(attribute)(import_file(Path(self.file)))

    @property
    def packages(self) -> tuple[str, ...]:
        """Distributions with that module's top-level package; none for a user's file."""
        return tuple(_distributions().get(self.target.partition(".")[0].partition(":")[0], ()))

    def checked(self) -> ParallelEnv:
        """Create a first environment and check it.

        Raises:
            ConfigError: the callable fails, or gives no ``ParallelEnv`` of two agents.
        """
        name = f"game pettingzoo:{self.target}"
        try:
            env = self()
        except failures() as error:
            raise ConfigError(f"{name}: the environment cannot be made: {reason_of(error)}") from error
        if isinstance(env, AECEnv):
            raise ConfigError(f"{name}: this is an AECEnv, played in turns; name its parallel_env instead")
        if not isinstance(env, ParallelEnv):
            raise ConfigError(f"{name}: expected a PettingZoo ParallelEnv, got {type(env).__name__}")
        agents = list(env.possible_agents)
        if len(agents) != 2:
            raise ConfigError(f"{name}: a game has two agents, this one {len(agents)}: {', '.join(agents)}")
        return env

    def __call__(self) -> ParallelEnv:
        """One environment."""
        with prints_to_stderr():
            return self.callable(**self.kwargs)


@cache
def _distributions() -> Mapping[str, list[str]]:
    return packages_distributions()


@contextmanager
def prints_to_stderr() -> Iterator[None]:
    """Redirect prints of libraries and environments: stdout is reserved for results (``--json``)."""
    with redirect_stdout(sys.stderr):
        yield

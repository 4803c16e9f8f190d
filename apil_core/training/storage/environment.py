"""The environment of a session, as ``environment.json`` keeps it."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from apil_core.training.distributed.world import World

_PACKAGES = ("apil", "torch", "mujoco", "numpy", "rsl-rl-lib", "gymnasium", "pettingzoo", "tensordict")


def environment(command: Sequence[str]) -> dict[str, Any]:
    """Environment that results may depend on: command, versions, host and the code's git state."""
    return {
        "command": list(command),
        "processes": World.here().size,
        "time": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "python": sys.version.split()[0],
        "versions": {name: _version(name) for name in _PACKAGES},
        "host": platform.node(),
        "platform": platform.platform(),
        "cpus": os.cpu_count(),
        "git": _git_state(),
    }


def code_and_time() -> dict[str, str]:
    """What a policy's file says of its making: ``code`` (version and git state) and ``time``."""
    made = environment(())
    return {
        "code": f"apil {made['versions']['apil']}, git {made['git'] or 'unknown'}",
        "time": made["time"],
    }


@cache
def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "absent"


def _git_state() -> str:
    command = ["git", "--no-optional-locks", "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        done = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=5, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip()

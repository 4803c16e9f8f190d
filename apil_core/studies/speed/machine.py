"""Where speed was measured."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path

from apil_core.common.machine import usable_cpus
from apil_core.studies.speed.report import Machine

_PACKAGES = ("apil", "mujoco", "torch", "numpy", "rsl-rl-lib", "pluggy")


def this_machine() -> Machine:
    """This one, and how busy it is."""
    load = os.getloadavg()[0]
    return Machine(
        cpu=_cpu(),
        cpus=os.cpu_count() or 1,
        usable_cpus=usable_cpus(),
        platform=platform.platform(),
        python=platform.python_version(),
        versions={name: metadata.version(name) for name in _PACKAGES},
        load_before=load,
        load_after=load,
    )


def _cpu() -> str:
    """The processor's name: Python's own answer is empty on most Linux machines."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())

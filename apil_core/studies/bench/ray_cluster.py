"""Connect to a Ray cluster, or start one on this machine, quickly and quietly."""

from __future__ import annotations

import os
import socket
from typing import Any
from urllib.parse import urlsplit

from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.extras import need

_PATIENCE = 5.0
"""Seconds to wait for a cluster's answer; Ray itself would try for two minutes."""

_STORE = 80 * 2**20
"""Bytes of memory for objects that tasks share, Ray's least: jobs share files."""


def connect(address: str | None, cpus: int | None) -> Any:
    """Join a cluster; return the module ``ray``.

    Args:
        address: ``HOST:PORT``, ``auto`` for the one this machine is part of, or ``None`` for a new one here.
        cpus: of a new one; ``None``: this machine's.

    Raises:
        ApilError: Ray is missing, there is no cluster at that address, or none can be started.
    """
    # no usage statistics unless the user enables them; read when Ray is imported
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    ray = need("ray")
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    try:
        if address is None:
            ray.init("local", num_cpus=cpus, include_dashboard=False, object_store_memory=_STORE, **quiet)
        else:
            if address != "auto":
                _knock(address)
            ray.init(address, **quiet)
    except ConfigError:
        raise
    except (Exception, SystemExit) as error:  # Ray exits if the server at the address is no cluster
        what = "Ray does not start here" if address is None else f"--address {address}: no Ray cluster there"
        reason = "it does not answer" if isinstance(error, SystemExit) else " ".join(str(error).split())
        raise ApilError(f"{what}: {reason[:300]}") from error
    return ray


def slots(ray: Any, threads: int) -> int:
    """Number of jobs of that many CPUs that the cluster's nodes can run in parallel.

    Raises:
        ApilError: not one fits on any node: Ray would wait forever.
    """
    cpus = [int(node["Resources"].get("CPU", 0)) for node in ray.nodes() if node["Alive"]]
    fitting = sum(count // threads for count in cpus)
    if not fitting:
        raise ApilError(
            f"--threads {threads}: no node of the Ray cluster has as many CPUs, the largest has {max(cpus)}"
        )
    return fitting


def _knock(address: str) -> None:
    """Check that something listens at the address.

    Raises:
        ConfigError: not a valid address.
        OSError: nothing does.
    """
    try:
        parts = urlsplit(address if "://" in address else f"//{address}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise ConfigError(f"--address {address}: expected auto or HOST:PORT, e.g. ray-head:6379")
    with socket.create_connection((host, port), timeout=_PATIENCE):
        pass

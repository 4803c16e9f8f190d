"""Libraries that only some commands need."""

from __future__ import annotations

import importlib
import json
import shlex
from collections.abc import Mapping
from importlib import metadata
from types import ModuleType
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

from apil_core.common.errors import ApilError

_EXTRAS = {
    "av": ("PyAV", "videos", "video"),
    "matplotlib": ("matplotlib", "charts", "report"),
    "pandas": ("pandas", "frames of metrics and scores", "notebook"),
    "onnxruntime": ("onnxruntime", "ONNX policies", "onnx"),
    "optuna": ("optuna", "studies of settings", "tune"),
    "ray": ("ray", "Ray clusters", "ray"),
    "sklearn": ("scikit-learn", "analyses of activations", "analysis"),
    "stable_baselines3": ("stable-baselines3", "views for Stable-Baselines3", "sb3"),
    "trackio": ("trackio", "records in Trackio", "trackio"),
    "wandb": ("wandb", "records in Weights & Biases", "wandb"),
}
"""By import name: the library, the feature that needs it, and APIL's extra that installs it."""


def need(*modules: str) -> ModuleType:
    """Import libraries of optional extras; returns the last.

    Raises:
        ApilError: one is not installed; names the extra that installs it.
    """
    try:
        return [importlib.import_module(module) for module in modules][-1]
    except ModuleNotFoundError as error:
        raise missing(error.name) or error from error


def missing(module: str | None) -> ApilError | None:
    """Extra that installs a missing module, or ``None``."""
    module = (module or "").partition(".")[0]
    if module not in _EXTRAS:
        return None
    library, purpose, extra = _EXTRAS[module]
    return ApilError(f"{purpose} need {library}: {install_command(extra)}")


def install_command(extra: str) -> str:
    """The command that adds one of APIL's extras to this installation, from where that was installed."""
    try:
        origin = json.loads(metadata.distribution("apil").read_text("direct_url.json") or "{}")
    except (metadata.PackageNotFoundError, ValueError):
        origin = {}
    return _command(extra, origin)


def _command(extra: str, origin: Mapping[str, Any]) -> str:
    """The same for the content of pip's ``direct_url.json`` (PEP 610), empty for an index."""
    url, wanted = origin.get("url", ""), f"apil[{extra}]"
    if origin.get("dir_info", {}).get("editable"):
        return f"pip install -e {shlex.quote(f'{url2pathname(urlsplit(url).path)}[{extra}]')}"
    if made := origin.get("vcs_info"):
        url = f"{made['vcs']}+{url}@{made['commit_id']}"
    return f"pip install {shlex.quote(f'{wanted} @ {url}' if url else wanted)}"

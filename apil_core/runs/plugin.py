"""Recorders for experiment trackers, and hardened victims; imports neither torch nor mujoco."""

from __future__ import annotations

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import PolicySpec, RecorderSpec

APIL_HOOK_API = 2


@hookimpl
def register_recorders() -> list[RecorderSpec]:
    """Register recorders for Weights & Biases and Trackio."""
    return [
        RecorderSpec(
            "wandb",
            "apil_core.runs.trackers.wandb_recorder:WandbRecorder",
            "a tracked run at Weights & Biases, online or offline (docs/trackers.md)",
            check="apil_core.runs.trackers.wandb_recorder:check",
        ),
        RecorderSpec(
            "trackio",
            "apil_core.runs.trackers.trackio_recorder:TrackioRecorder",
            "a tracked run in Trackio, local by default (docs/trackers.md)",
            check="apil_core.runs.trackers.trackio_recorder:check",
        ),
    ]


@hookimpl
def register_policies() -> list[PolicySpec]:
    """Register ``retrained:DIR``."""
    return [
        PolicySpec(
            scheme="retrained",
            loader="apil_core.runs.retraining.folder:load",
            summary="victim hardened by `apil retrain`: retrained:DIR",
            file=True,
        ),
    ]

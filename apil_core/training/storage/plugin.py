"""The core's own recorders, offered through the same door as a third party's."""

from __future__ import annotations

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import RecorderSpec

APIL_HOOK_API = 2


@hookimpl
def register_recorders() -> list[RecorderSpec]:
    """Metrics as JSON lines, as TensorBoard events, and to experiment trackers."""
    return [
        RecorderSpec(
            "jsonl",
            "apil_core.training.storage.recorders:JsonlRecorder",
            "metrics.jsonl, one line per row of metrics",
        ),
        RecorderSpec(
            "tensorboard",
            "apil_core.training.storage.recorders:TensorBoardRecorder",
            "events for TensorBoard",
        ),
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

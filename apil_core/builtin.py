"""The core's own recorders, offered through the same door as a third party's."""

from __future__ import annotations

from apil_core.hooks import hookimpl
from apil_core.specs import RecorderSpec


@hookimpl
def register_recorders() -> list[RecorderSpec]:
    """Metrics as JSON lines and as TensorBoard events."""
    return [
        RecorderSpec(
            "jsonl", "apil_core.recorders:JsonlRecorder", "metrics.jsonl, one line per row of metrics"
        ),
        RecorderSpec("tensorboard", "apil_core.recorders:TensorBoardRecorder", "events for TensorBoard"),
    ]

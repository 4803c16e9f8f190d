"""Recorders, and policies from runs, exported files and the package; imports neither torch nor mujoco."""

from __future__ import annotations

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import PolicySpec, RecorderSpec

APIL_HOOK_API = 2


@hookimpl
def register_recorders() -> list[RecorderSpec]:
    """Offer metrics as JSON lines and as TensorBoard events."""
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
    ]


@hookimpl
def register_policies() -> list[PolicySpec]:
    """Offer ``embedded:<game>/<role>/<version>``, ``run:DIR`` and ``safetensors:FILE``."""
    return [
        PolicySpec(
            "embedded",
            "apil_core.training.export.embedded:load",
            lister="apil_core.training.export.embedded:list_embedded",
            summary="shipped with APIL: students of the zoo's agents, and adversaries trained against them",
            seat=True,
            plugins=True,
        ),
        PolicySpec(
            "run",
            "apil_core.training.export.run_policy:load",
            summary="what a run trained: run:DIR, its newest checkpoint",
            seat=True,
            plugins=True,
            file=True,
        ),
        PolicySpec(
            "safetensors",
            "apil_core.training.export.safetensors:load",
            summary="adversary from `apil export`, or student from `apil distill`: safetensors:FILE",
            seat=True,
            plugins=True,
            file=True,
        ),
    ]

"""Plugin that registers loaders of third-party policies; imports neither torch nor mujoco."""

from __future__ import annotations

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import PolicySpec

APIL_HOOK_API = 2

_HERE = "apil_core.policies.foreign"


@hookimpl
def register_policies() -> list[PolicySpec]:
    """Register network files and Python callables, each ``<scheme>:<path or name>``."""
    return [
        PolicySpec(
            "torchscript",
            f"{_HERE}.torchscript:load",
            summary="network saved with torch.jit: torchscript:FILE",
            seat=True,
            file=True,
        ),
        PolicySpec(
            "torch-export",
            f"{_HERE}.torch_export:load",
            summary="network saved with torch.export: torch-export:FILE.pt2",
            seat=True,
            file=True,
        ),
        PolicySpec(
            "onnx",
            f"{_HERE}.onnx:load",
            summary="network in ONNX, with the extra onnx: onnx:FILE",
            seat=True,
            file=True,
        ),
        PolicySpec(
            "sb3",
            f"{_HERE}.sb3:load",
            summary="agent of Stable-Baselines3 or sb3-contrib: sb3:FILE.zip",
            file=True,
        ),
        PolicySpec(
            "python",
            f"{_HERE}.python:load",
            summary="callable of yours: python:MODULE:CALLABLE",
            seat=True,
            runs_code=True,
        ),
    ]

"""``apil export``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from apil_core.cli.flags import Json, Plugins
from apil_core.cli.output import console, emit

if TYPE_CHECKING:
    from apil_core.training.export.export import Exported


def export(
    run: Annotated[str, Parameter(name="RUN", help="Run directory.")],
    /,
    *,
    format: Annotated[
        Literal["onnx", "torchscript", "safetensors"],
        Parameter(help="onnx or torchscript: a network for any program; safetensors: for apil, exactly."),
    ],
    out: Annotated[
        Path | None, Parameter(help="File to write [default: adversary.onnx, .pt or .safetensors in RUN].")
    ] = None,
    checkpoint: Annotated[
        Path | None, Parameter(help="Checkpoint of the run to take, or best [default: the newest].")
    ] = None,
    plugin: Plugins | None = None,
    force: Annotated[bool, Parameter(show_default=False, help="Replace the file if it exists.")] = False,
    as_json: Json = False,
) -> None:
    """Write a trained adversary to one file that other programs, or apil again, can load.

    The file is loaded again and must act as the run does, on observations of real games.
    """
    from apil_core.training.export.export import export as write

    files = tuple(str(path) for path in plugin or ())
    result = write(run, format, out, checkpoint_path=checkpoint, plugin_files=files, force=force)
    emit(result, as_json, lambda: _print(result))


def _print(result: Exported) -> None:
    out = console()
    out.print(f"{result.file}  sha256 {result.sha256[:12]}")
    if result.reads:
        out.print(f"inputs: {', '.join(result.reads)}; outputs: mean, log_std")
    out.print(f"acts as the run does: largest difference {result.difference:.1g}")
    out.print(f"load it as {result.name}")

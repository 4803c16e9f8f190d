"""``apil runs plot``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from apil_core.cli.flags import Json
from apil_core.cli.output import emit, print_facts
from apil_core.common.errors import ConfigError
from apil_core.config.kind import is_retraining

if TYPE_CHECKING:
    from apil_core.studies.curves.groups import CurveGroup


def plot(
    *directories: Annotated[
        Path,
        Parameter(name="DIR", required=True, help="Runs, or directories of several; or one retraining."),
    ],
    out: Annotated[Path, Parameter(help="Picture to write: .png, .svg or .pdf.")] = Path("curve.png"),
    metric: Annotated[
        list[str] | None,
        Parameter(
            metavar="NAME", help="One more panel with this metric of metrics.jsonl, e.g. ppo/kl; repeatable."
        ),
    ] = None,
    force: Annotated[bool, Parameter(show_default=False, help="Replace the picture if it exists.")] = False,
    as_json: Json = False,
) -> None:
    """Draw learning curves: shares of games won and tied, return and imitator over environment steps.

    Runs that differ in the seed only become one line, their mean, with their standard deviation as a band.
    Points are evaluations with 95 % intervals. Of a retraining: the victim's shares against each opponent.
    """
    from apil_core.common.charts import check_picture
    from apil_core.common.files import check_free
    from apil_core.studies.curves.groups import read_groups
    from apil_core.studies.curves.picture import draw_curves
    from apil_core.training.storage.run_list import runs_in

    check_picture(out)
    check_free(out, force=force)
    retrainings = [directory for directory in directories if is_retraining(directory)]
    if retrainings:
        groups = _draw_retraining(directories, retrainings[0], metric or [], out)
    else:
        groups = read_groups(runs_in(directories), metric or [])
        draw_curves(groups, out)
    emit({"picture": out, "groups": groups}, as_json, lambda: print_facts(curve=out))


def _draw_retraining(
    directories: Sequence[Path], retraining: Path, metrics: Sequence[str], out: Path
) -> list[CurveGroup]:
    from apil_core.runs.retraining.folder import RetrainDir
    from apil_core.studies.curves.retraining import draw_opponents

    if len(directories) > 1:
        raise ConfigError(f"{retraining} is a retraining: draw it alone")
    if metrics:
        raise ConfigError(f"{retraining} is a retraining: its picture has no panel for --metric")
    return draw_opponents(RetrainDir(retraining), out)

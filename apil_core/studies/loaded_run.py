"""A run's directory, read for a notebook: settings, numbers as pandas frames, pictures and films."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.api.config import RunConfig
from apil_core.common.extras import need
from apil_core.evaluation.options import PairingOptions, RenderOptions
from apil_core.evaluation.pairing import load_pairing
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.video.recording import check_files, show
from apil_core.evaluation.video.single_game import Outcome
from apil_core.studies.bench.folder import read_score
from apil_core.studies.curves.curves import final_scores
from apil_core.studies.curves.groups import read_groups
from apil_core.training.storage.recorders import read_metrics
from apil_core.training.storage.run_dir import RunDir
from apil_core.training.storage.run_list import runs_in

if TYPE_CHECKING:
    from pandas import DataFrame

_RATES = ("win", "tie", "loss", "win_or_tie")


@dataclass(frozen=True)
class Media:
    """A picture or a film; a notebook shows it.

    Attributes:
        data: the file's bytes.
        kind: ``image/png`` or ``video/mp4``.
    """

    data: bytes = field(repr=False)
    kind: str

    def save(self, path: Path | str) -> None:
        """Write the file; one of that name is replaced."""
        Path(path).write_bytes(self.data)

    def _repr_html_(self) -> str:
        source = f'src="data:{self.kind};base64,{base64.b64encode(self.data).decode()}"'
        return f"<video controls {source}></video>" if "video" in self.kind else f"<img {source}>"


class LoadedRun(PathLike[str]):
    """A run, finished or not; may stand wherever a run's directory does.

    Attributes:
        path: its directory.
        config: its settings.
    """

    def __init__(self, path: PathLike[str] | str):
        self._run = RunDir(Path(path))
        self.path = self._run.path
        self.config: RunConfig = self._run.config()

    def __fspath__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        done = self._run.summary()
        name = f"{self.config.method} on {self.config.env}, seed {self.config.seed}"
        return f"<run {self.path}: {name}, {done['steps']:,} steps, {done['status']}>"

    @property
    def result(self) -> dict[str, Any] | None:
        """Content of ``result.json``, or ``None`` before the first end."""
        return self._run.result()

    @property
    def metrics(self) -> DataFrame:
        """Logged iterations by environment steps (the index), a column per metric.

        Raises:
            RunDirError: there are none, or they are damaged.
        """
        frame: DataFrame = need("pandas").DataFrame(read_metrics(self._run.metrics_path))
        return frame.set_index("steps")

    @property
    def scores(self) -> DataFrame:
        """Evaluations, a row each: ``during training``, ``final``, and those kept under a name.

        Columns: ``name``, ``steps``, ``games``; fractions of games ``win``, ``tie``, ``loss`` and
        ``win_or_tie`` with their Wilson 95 % intervals (``win_low``, ``win_high``); ``victim``, ``physics``,
        ``blind``, ``blind_victim``.
        """
        frame: DataFrame = need("pandas").DataFrame(self._scores())
        return frame

    def plot(self, *metrics: str) -> Media:
        """See :func:`plot_runs`."""
        return plot_runs([self], metrics)

    def film(self, until: Outcome | None = "win", **options: Any) -> Media:
        """Record a game.

        Args:
            until: the first one that ends like this for the adversary; ``None``: the first.
            options: of the pairing (``victim``, ``physics``, ``seed``, …: docs/python.md) and of the film:
                ``width`` and ``height`` (pixels), ``fps``, ``speed`` (1: real time), ``episodes`` (to try).

        Raises:
            ApilError: drawing is impossible here, or no game ended like that.
        """
        drawn = {
            key: options.pop(key) for key in ("width", "height", "fps", "speed", "episodes") & options.keys()
        }
        pairing_options = PairingOptions(**options)
        with tempfile.TemporaryDirectory() as folder:
            video = Path(folder) / "game.mp4"
            rendering = RenderOptions(seed=pairing_options.seed, until=until, video=video, **drawn)
            check_files(rendering)
            with load_pairing(self, pairing_options, threads=1) as pairing:
                show(pairing, rendering)
            return Media(video.read_bytes(), "video/mp4")

    def _scores(self) -> Iterator[dict[str, Any]]:
        for row in read_metrics(self._run.metrics_path):
            if "evaluation/win" in row:
                names = [f"{rate}{end}" for rate in _RATES for end in ("", "_low", "_high")]
                rates = {name: row[f"evaluation/{name}"] for name in names}
                counts = {"steps": int(row["steps"]), "games": int(row["evaluation/episodes"])}
                yield {"name": "during training", **counts, **rates}
        kept = sorted(path.stem for path in (self.path / "scores").glob("*.json"))
        scores = [("final", score) for score in final_scores(self._run)]
        for name, score in [*scores, *((name, read_score(self.path, name)) for name in kept)]:
            yield {"name": name, "steps": score.trained_steps, **_score(score)}


def load_run(path: PathLike[str] | str) -> LoadedRun:
    """Read a run's directory.

    Raises:
        RunDirError: there is none.
    """
    return LoadedRun(path)


def plot_runs(runs: Sequence[PathLike[str] | str], metrics: Sequence[str] = ()) -> Media:
    """Draw learning curves as ``apil runs plot`` does: runs that differ in the seed only become one line.

    Args:
        runs: their directories, or directories of several.
        metrics: further panels, by name of the metric.

    Raises:
        ApilError: a run has too few games for a curve, or lacks a metric; matplotlib is missing.
    """
    need("matplotlib")
    from apil_core.studies.curves.picture import draw_curves

    groups = read_groups(runs_in(list(map(Path, runs))), metrics)
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "curve.png"
        draw_curves(groups, picture)
        return Media(picture.read_bytes(), "image/png")


def _score(score: EvaluationResult) -> dict[str, Any]:
    rates: dict[str, Any] = {"games": score.episodes}
    for name in _RATES:
        rate = getattr(score, f"{name}_rate")
        rates |= {name: rate.value, f"{name}_low": rate.low, f"{name}_high": rate.high}
    return {
        **rates,
        "victim": score.victim.name,
        "physics": score.physics,
        "blind": score.blind,
        "blind_victim": score.blind_victim,
    }

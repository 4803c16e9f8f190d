"""Metrics for Weights & Biases, online or offline."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from apil_core.common.errors import ApilError
from apil_core.common.extras import need
from apil_core.runs.trackers.tracked import PROJECT, TrackedRun, one_line
from apil_core.training.storage.recorders import read_metrics

FINISH_SECONDS = 60.0
"""Seconds that the end of a run waits for uploads; the rest stays on disk for ``wandb sync``."""

_HINT = "WANDB_MODE=offline records without a server"
_OFFLINE = ("offline", "dryrun")


class WandbRecorder:
    """A tracked run at wandb, kept in ``<run_dir>/wandb``; its id in ``<run_dir>/wandb.json``.

    wandb's own settings (environment variables, ``wandb/settings``) take precedence; but a resumed run
    stays in the project it began in. Steps are environment steps. When a run is resumed

    - offline, a new file begins with the rows that ``metrics.jsonl`` kept: the newest one has them all;
    - online, rows at steps that the server has already are left out: it takes no step twice.

    Args:
        run_dir: a run directory.

    Raises:
        ApilError: wandb is missing, not logged in, or does not reach its server.
    """

    name = "wandb"
    dispensable = True

    def __init__(self, run_dir: Path):
        wandb = need("wandb")
        tracked = TrackedRun.of(run_dir)
        with one_line(self.name, _HINT):
            settings = wandb.setup().settings
            ours = _ours(tracked, settings)
            self._run: Any = wandb.init(
                config=tracked.config,
                allow_val_change=True,  # a resumed run may have more steps
                reinit="create_new",  # leave another run in this process alone
                settings=wandb.Settings(**ours),
            )
        self._next = int(self._run.starting_step)
        if self._run.disabled:
            return
        resumed = bool(tracked.where(self.name))
        keys = {"id": self._run.id, "project": self._run.project, "entity": self._run.entity}
        tracked.note_where(self.name, {key: value for key, value in keys.items() if value})
        if resumed and self._run.offline and tracked.run_dir.metrics_path.is_file():
            for row in read_metrics(tracked.run_dir.metrics_path):
                self.record(row)

    def record(self, metrics: Mapping[str, float]) -> None:
        """Log one row at ``metrics["steps"]``."""
        step = int(metrics["steps"])
        if step >= self._next:
            self._run.log(dict(metrics), step=step, commit=True)
            self._next = step + 1

    def summarize(self, scores: Mapping[str, float]) -> None:
        """Put the final scores into the run's summary."""
        self._run.summary.update(dict(scores))

    def close(self) -> None:
        """Wait for uploads, within a limit; after an error the run is shown as failed."""
        self._run.finish(exit_code=int(sys.exc_info()[0] is not None))


def check() -> None:
    """Check that wandb is usable, before anything is built.

    Raises:
        ApilError: wandb is not installed, not logged in, or does not reach its server.
    """
    wandb = need("wandb")
    with one_line("wandb", _HINT):
        if wandb.setup().settings.mode in (*_OFFLINE, "disabled") or wandb.run is not None:
            return
        if not wandb.login(prompt=False, verify=True):
            raise ApilError(f"recorder wandb: not logged in: run `wandb login` ({_HINT})")


def _ours(tracked: TrackedRun, settings: Any) -> dict[str, Any]:
    """Return the settings that the user left unset, and the id of a resumed run."""
    where = tracked.where("wandb")
    defaults = {
        "project": PROJECT,
        "run_name": tracked.name,
        "run_group": tracked.group,
        "run_tags": tuple(tag[:64] for tag in tracked.tags),  # longer ones are refused
        "root_dir": str(tracked.run_dir.path.resolve()),
        "console": "off",  # a live view is not worth logging
        "finish_timeout": FINISH_SECONDS,
        "max_end_of_run_history_metrics": 0,
        "max_end_of_run_summary_metrics": 0,
    }
    given = settings.model_fields_set
    ours = {key: value for key, value in defaults.items() if key not in given}
    if where:
        ours |= {"run_id": where["id"], "project": where["project"]}
        ours |= {"entity": where["entity"]} if "entity" in where else {}
        if not given & {"resume", "resume_from", "fork_from"}:
            ours["resume"] = "allow"
    return ours

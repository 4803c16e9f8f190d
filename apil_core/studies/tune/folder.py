"""A study's directory: what is varied, what all trials share, and Optuna's journal of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import optuna
from optuna.samplers import TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial, Trial, TrialState

from apil_core.api.config import RunConfig
from apil_core.common.errors import ConfigError, RunDirError
from apil_core.common.files import LOCK, is_taken, locked, read_json, write_atomically
from apil_core.common.seeds import stream_seed
from apil_core.common.trust import remember
from apil_core.config.resolve import differences, dump_yaml, load_resolved
from apil_core.plugins.registry import plugins_with
from apil_core.studies.tune.space import Space
from apil_core.training.storage.run_dir import RunDir

if TYPE_CHECKING:
    from optuna import Study

_FREE = ("threads", "trust")
"""Settings that do not change a study."""
_PATIENCE = 60.0
"""Seconds to wait for another worker that takes a trial."""


class SeededSampler(TPESampler):
    """TPE with a random stream for each trial, so that a study resumes with the same suggestions."""

    def __init__(self, seed: int):
        self._stream = seed
        super().__init__(seed=seed)

    def before_trial(self, study: Study, trial: FrozenTrial) -> None:
        """Begin the trial's stream."""
        seed = stream_seed(self._stream, f"tune trial {trial.number}") % 2**32
        TPESampler.__init__(self, seed=seed, constant_liar=True)
        super().before_trial(study, trial)


class StudyDir:
    """Paths and contents of a study.

    Args:
        path: its directory; it need not exist yet.
    """

    def __init__(self, path: Path | str):
        self.path = Path(path)
        self.settings_path = self.path / "settings.yaml"
        self.space_path = self.path / "space.json"
        self.best_path = self.path / "best.yaml"
        self.trials = self.path / "trials"

    def config(self) -> RunConfig:
        """The settings that trials share.

        Raises:
            RunDirError: there is no study.
        """
        if not self.settings_path.is_file():
            raise RunDirError(f"{self.path} is no study (no settings.yaml in it)")
        return load_resolved(self.settings_path)

    def space(self) -> Space:
        """The search space, with those settings."""
        config = self.config()
        return Space(read_json(self.space_path), config, plugins_with(config.plugins))

    def begin(self, space: Space) -> None:
        """Create the directory, or check that its study is the same.

        Raises:
            RunDirError: it holds something else.
            ConfigError: its study was begun with other settings.
        """
        if self.settings_path.is_file():
            self._check_same(space)
            return
        if is_taken(self.path):
            raise RunDirError(f"{self.path} exists and is no study; choose another --out")
        self.trials.mkdir(parents=True, exist_ok=True)
        for path, text in (
            (self.space_path, json.dumps(space.content, indent=1)),
            (self.settings_path, dump_yaml(space.config, space.plugins)),  # last: it makes it a study
        ):
            write_atomically(path, lambda file, text=text: file.write(text.encode()))  # type: ignore[misc]
        remember(self.path)

    def lock(self) -> Any:
        """Lock the study against other commands; its workers are not held up."""
        self.path.mkdir(parents=True, exist_ok=True)
        return locked(self.path / LOCK, f"another process is tuning in {self.path}")

    def study(self) -> Study:
        """Optuna's study; made if there is none."""
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        journal = str(self.path / "journal.log")
        storage = JournalStorage(JournalFileBackend(journal, JournalFileOpenLock(journal)))
        return optuna.create_study(
            storage=storage,
            study_name="apil",
            direction="maximize",
            load_if_exists=True,
            sampler=SeededSampler(self.config().seed),
            # the first evaluations are of policies that hardly differ from random ones
            pruner=optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=3),
        )

    def run(self, number: int) -> RunDir:
        """The run of a trial."""
        return RunDir(self.trials / f"{number:04d}")

    @contextmanager
    def next_trial(self, study: Study, trials: int) -> Iterator[Trial | None]:
        """Take an interrupted trial that no process has, or a new one; ``None`` if all are done or taken.

        Args:
            study: of :meth:`study`.
            trials: of the study in all.
        """
        with ExitStack() as held:
            with locked(
                self.path / ".next.lock", f"no trial of {self.path} can be taken", patience=_PATIENCE
            ):
                trial = self._interrupted(study, held)
                begun = [t for t in study.get_trials(deepcopy=False) if t.state != TrialState.WAITING]
                if trial is None and len(begun) < trials:
                    trial = study.ask()
                    held.enter_context(self._taken(trial.number))
            yield trial

    def _interrupted(self, study: Study, held: ExitStack) -> Trial | None:
        for found in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            with suppress(RunDirError):  # another worker's
                held.enter_context(self._taken(found.number))
                return Trial(study, found._trial_id)
        return None

    def _taken(self, number: int) -> Any:
        return locked(self.trials / f".{number:04d}.lock", f"trial {number} is another process's")

    def _check_same(self, space: Space) -> None:
        changed = {
            key: values
            for key, values in differences(self.config(), space.config).items()
            if key.split(".")[0] not in _FREE
        }
        if read_json(self.space_path) != json.loads(json.dumps(space.content)):
            changed["the search space"] = ("another", "this")
        if changed:
            key, (before, now) = next(iter(changed.items()))
            more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
            raise ConfigError(
                f"{self.path} was begun with {key} {before}, now it is {now}{more}; choose another --out, "
                f"or go on as it was begun: apil tune {self.path}"
            )

"""``retrained:DIR``: the victim a retraining has made so far."""

from __future__ import annotations

from pathlib import Path

from apil_core.common.errors import VictimError
from apil_core.config.kind import is_retraining
from apil_core.policies.student_policy import StudentPolicy
from apil_core.runs.retraining.folder import RetrainDir

SCHEME = "retrained"


def name_of(path: Path) -> str:
    """Full name of the hardened victim in that directory."""
    return f"{SCHEME}:{path.expanduser().absolute()}"


def load(name: str) -> StudentPolicy:
    """A fresh policy on the CPU; its file is a student's (:mod:`apil_core.policies.student`).

    Args:
        name: directory of the retraining.

    Raises:
        VictimError: there is no retraining, it has no victim yet, or the file is damaged.
    """
    from apil_core.policies.student import load_file

    path = Path(name).expanduser()
    directory = RetrainDir(path)
    if not directory.victim_path.is_file():
        why = "has no victim yet: it comes with the first checkpoint" if is_retraining(path) else "is none"
        raise VictimError(f"{SCHEME}:{name}: {SCHEME}:DIR is the directory of a retraining, and {path} {why}")
    return load_file(directory.victim_path, name_of(path))

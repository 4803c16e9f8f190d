"""Trying something in a process of its own: whatever breaks there, breaks only there."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

PATIENCE = 120.0
"""Seconds a trial may take; a busy machine needs some to import torch."""


class TrialError(Exception):
    """A trial failed; the message says how, in one line."""


def attempt(
    probe: str,
    *arguments: str,
    plugin_files: Sequence[Path] = (),
    environment: Mapping[str, str] | None = None,
    patience: float = PATIENCE,
) -> dict[str, Any]:
    """What a function of :mod:`apil_core.cli.doctor_checks.probes` gives.

    Args:
        probe: its name.
        arguments: handed to it after the plugins.
        plugin_files: one-file plugins to load first.
        environment: variables to set in its process.
        patience: seconds it may take.

    Raises:
        TrialError: it raised, took too long, or its process died.
    """
    order = json.dumps([probe, [str(path) for path in plugin_files], arguments])
    # -P: like the console script, it must not take the user's folder for a place of libraries
    command = [sys.executable, "-P", "-m", "apil_core.cli.doctor_checks.probes", order]
    try:
        done = subprocess.run(
            command,
            env={**os.environ, **(environment or {})},
            capture_output=True,
            text=True,
            errors="replace",
            timeout=patience,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        raise TrialError(f"no answer within {patience:.0f} s") from None
    answer = _answer(done.stdout)
    if answer is None:
        raise TrialError(_end(done.returncode, done.stderr))
    if "error" in answer:
        raise TrialError(answer["error"])
    return answer


def _answer(output: str) -> dict[str, Any] | None:
    """The last line, if it is an answer: others may print too."""
    try:
        answer = json.loads(output.rstrip().rpartition("\n")[2])
    except ValueError:
        return None
    return answer if isinstance(answer, dict) else None


def _end(code: int, stderr: str) -> str:
    if code < 0:
        try:
            return f"its process was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"its process was ended by signal {-code}"
    last = stderr.strip().rpartition("\n")[2]
    return f"its process ended with exit code {code}: {last or 'no message'}"

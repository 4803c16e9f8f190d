"""Writes down what happens when a tutorial is followed as printed: every command, its output and its seconds.

    python tests/docs/transcript.py docs/tutorial/write-an-attack.md docs/results/authors-afternoon.md

The environment is the one in which the slow tests follow the tutorials. Long outputs lose their middle.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from docs.following import follow, own_environment
from docs.pages import ROOT

KEPT = 14
"""Lines of a long output that stay at either end."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("page", type=Path, help="the tutorial")
    parser.add_argument("out", type=Path, help="Markdown file to write")
    flags = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        parts, seconds = followed(flags.page.resolve(), Path(folder))
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    page = os.path.relpath(flags.page.resolve(), flags.out.resolve().parent)
    head = [
        "# An author's afternoon: a transcript",
        "",
        f"Everything that [the tutorial]({page}) says, done by `tests/docs/transcript.py` on "
        f"{datetime.now(UTC):%Y-%m-%d} at commit {commit}, on {os.cpu_count()} cores: "
        f"**{seconds / 60:.1f} minutes** of machine time. The edits between the commands are the page's.",
    ]
    flags.out.write_text("\n".join([*head, *parts]) + "\n", "utf-8")
    print(f"{flags.out}: {seconds:.0f} s")


def followed(page: Path, folder: Path) -> tuple[list[str], float]:
    """What to write down, and how many seconds the commands took together."""
    environment = {**own_environment(folder), "COLUMNS": "110", "TERM": "dumb", "NO_COLOR": "1"}
    work = folder / "work"
    work.mkdir()
    parts: list[str] = []
    total = 0.0

    def shell(command: str) -> None:
        nonlocal total
        begin = time.perf_counter()
        done = subprocess.run(
            command,
            shell=True,
            cwd=work,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - begin
        total += seconds
        if done.returncode:
            sys.exit(f"{command}: exit code {done.returncode}\n{done.stdout}")
        parts.extend(
            ["", f"{seconds:.1f} s", "", "```console", f"$ {command}", *shortened(done.stdout, folder), "```"]
        )

    follow(page, work, shell)
    return parts, total


def shortened(output: str, folder: Path) -> list[str]:
    """Its lines, without the temporary folder's name, and without the middle of a long output."""
    lines = [line.rstrip() for line in output.replace(str(folder), "~").splitlines()]
    lines = [line for line in lines if line and not line.startswith("Looking in ")]  # pip, on this machine
    left_out = len(lines) - 2 * KEPT
    if left_out <= 1:
        return lines
    return [*lines[:KEPT], f"[… {left_out} lines …]", *lines[-KEPT:]]


if __name__ == "__main__":
    main()

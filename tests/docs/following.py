"""Following a tutorial from top to bottom: its files, its changes, its commands."""

from __future__ import annotations

import os
import re
import sys
import venv
from collections.abc import Callable
from pathlib import Path

from docs.pages import Block, blocks

Shell = Callable[[str], None]


def changed(text: str, diff: str) -> str:
    """``text`` with a ``diff`` block applied; its old lines must stand there exactly once."""
    lines = diff.splitlines()
    assert all(line[:1] in ("+", "-", " ") for line in lines), diff
    old = "".join(f"{line[1:]}\n" for line in lines if line[0] in "- ")
    new = "".join(f"{line[1:]}\n" for line in lines if line[0] in "+ ")
    found = list(re.finditer(f"^{re.escape(old)}", text, re.M))
    assert len(found) == 1, f"not there, or more than once:\n{old}"
    return text[: found[0].start()] + new + text[found[0].end() :]


def commands(block: Block) -> list[str]:
    joined = block.text.replace("\\\n", " ")
    return [line for line in (line.split(" #")[0].strip() for line in joined.splitlines()) if line]


def follow(page: Path, folder: Path, shell: Shell) -> None:
    """Do what the page says, from top to bottom."""
    for block in blocks(page):
        if block.kind == "write":
            (folder / block.arguments[0]).write_text(block.text)
        elif block.kind == "change":
            file = folder / block.arguments[0]
            file.write_text(changed(file.read_text(), block.text))
        elif block.kind == "shell":
            for command in commands(block):
                shell(command)


def own_environment(folder: Path) -> dict[str, str]:
    """Variables of a Python environment made in ``folder`` that sees this one's packages, and a cache.

    pip builds there with what is installed, and installs no requirements.
    """
    home = folder / "env"
    venv.create(home, with_pip=False)
    (site,) = (home / "lib").glob("python*/site-packages")
    parents = [path for path in sys.path if path.endswith("site-packages")]
    (site / "parents.pth").write_text("".join(f"import site; site.addsitedir({p!r})\n" for p in parents))
    program = home / "bin" / "apil"
    program.write_text(f"#!{home}/bin/python\nimport sys\nfrom apil_core.cli import main\nsys.exit(main())\n")
    program.chmod(0o755)
    return {
        **os.environ,
        "PATH": f"{home / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "APIL_CACHE": str(folder / "cache"),
        "PIP_NO_BUILD_ISOLATION": "0",  # pip reads this switch as "no isolation"
        "PIP_NO_DEPS": "1",
    }

"""Writing a new plugin package from templates; the directory appears complete or not at all."""

from __future__ import annotations

import runpy
import shlex
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.api.hook_api import HOOK_API
from apil_core.common.errors import ConfigError
from apil_core.common.files import why_unwritable
from apil_core.plugins.scaffold.names import Names
from apil_core.plugins.scaffold.seat import Seat

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).with_name("templates")
"""``common`` and one folder per kind. ``PACKAGE`` and ``NAME`` in a path stand for the new names."""

_SUFFIX = ".jinja"


@dataclass(frozen=True)
class Written:
    """A package that was written.

    Attributes:
        names: of the plugin.
        directory: where it is, absolute.
        files: in it, relative and sorted.
        shown: the directory as the user named it, for commands.
    """

    names: Names
    directory: Path
    files: tuple[str, ...]
    shown: Path

    @property
    def commands(self) -> tuple[str, str, str]:
        """Commands to run next: install, test, run."""
        return (
            f"python -m pip install -e {shlex.quote(f'{self.shown}[test]')}",
            f"python -m pytest {shlex.quote(str(self.shown))}",
            f"apil run --config {shlex.quote(str(self.shown / 'config.yaml'))}",
        )


def write_package(names: Names, out: Path | None = None, seat: Seat | None = None) -> Written:
    """Write the package of ``names`` into ``out`` (default: a directory of that name here).

    Args:
        names: of the plugin; its kind picks the template.
        out: a directory that is empty, or not there yet.
        seat: of the victim, for that kind.

    Raises:
        ConfigError: the directory holds something, or cannot be made.
    """
    shown = out or Path(names.typed)
    directory = shown.resolve()
    _check_place(shown, directory)
    try:
        files = _write(names, seat, directory)
    except OSError as error:  # disk full, or another process created the file meanwhile
        raise ConfigError(f"{shown} cannot be written: {error.strerror or error}") from error
    return Written(names, directory, tuple(files), shown)


def _write(names: Names, seat: Seat | None, directory: Path) -> list[str]:
    """Make it beside ``directory``, or inside if that is there, and move it; returns the files, sorted."""
    near = directory if directory.is_dir() else directory.parent
    with tempfile.TemporaryDirectory(prefix=".apil-new-", dir=near) as folder:
        made = Path(folder) / "package"
        made.mkdir()
        for path, text in rendered(names, seat):
            file = made / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, "utf-8")
        if seat is not None:
            runpy.run_path(str(made / "make_weights.py"), run_name="__main__")
        files = sorted(file.relative_to(made).as_posix() for file in made.rglob("*") if file.is_file())
        if directory.is_dir():  # empty, as just checked; kept, as it may be the user's current directory
            for child in made.iterdir():
                child.rename(directory / child.name)
        else:
            made.rename(directory)
    return files


def rendered(names: Names, seat: Seat | None = None) -> Iterator[tuple[str, str]]:
    """Path and text of every file, the templates filled in."""
    environment = _environment()
    values = _values(names, seat)
    for folder in ("common", names.kind):
        for template in sorted((TEMPLATES / folder).rglob(f"*{_SUFFIX}")):
            path = template.relative_to(TEMPLATES)
            target = path.relative_to(folder).as_posix().removesuffix(_SUFFIX)
            target = target.replace("PACKAGE", names.package).replace("NAME", names.identifier)
            yield target, environment.get_template(path.as_posix()).render(values)


def _values(names: Names, seat: Seat | None) -> dict[str, Any]:
    fields = ("kind", "slug", "identifier", "registered", "package", "distribution", "camel")
    known = {"hook_api": HOOK_API, "seat": seat, "year": date.today().year}
    return known | {field: getattr(names, field) for field in fields}


def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        # braces are common in the written files: Python, LaTeX, GitHub's ${{ … }}
        block_start_string="<%",
        block_end_string="%>",
        variable_start_string="<<",
        variable_end_string=">>",
        comment_start_string="<#",
        comment_end_string="#>",
    )


def _check_place(shown: Path, directory: Path) -> None:
    """Check before the first write that nothing would be overwritten and everything can be written."""
    if directory.exists() and not directory.is_dir():
        raise ConfigError(f"{shown} exists and is a file; choose another --out")
    try:
        above = next(folder for folder in directory.parents if folder.exists())
        if not above.is_dir():
            raise ConfigError(f"{shown} cannot be made: {above} is a file")
        if directory.is_dir() and any(directory.iterdir()):
            raise ConfigError(f"{shown} exists and is not empty; choose another --out")
        directory.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{shown} cannot be made: {error.strerror or error}") from error
    place = directory if directory.is_dir() else directory.parent
    if (reason := why_unwritable(place)) is not None:
        raise ConfigError(f"{shown} cannot be made: {place}: {reason}")

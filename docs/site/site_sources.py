"""Gathers the site's pages: docs/, plugins' and examples' READMEs, files they link to, generated references.

The pages are written for GitHub, where links go from file to file of the repository. Here every page gets its
place on the site and every link is written anew; a link to a file that is no page leads to the repository, if
``extra.source_url`` of mkdocs.yml names it, or else to a page that shows the file.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePosixPath

from site_links import outside_code, relative, resolved, rewrite, without_comments
from site_math import formulas, mathml

ROOT = Path(__file__).resolve().parents[2]
COPIED = (".png", ".svg", ".css", ".html", ".csv")
"""What is copied from docs/ as it is; scripts and data are shown only where a page links to them."""
MOVED = {
    "README.md": "overview.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "benchmarks/README.md": "benchmarks.md",
    "docs/README.md": "contents.md",
}
LANGUAGES = {
    ".py": "python",
    ".json": "json",
    ".ipynb": "json",
    ".yaml": "yaml",
    ".yml": "yaml",
    ".toml": "toml",
    ".cff": "yaml",
}
_HIDDEN = "---\nsearch:\n  exclude: true\n---\n\n"


class SiteError(Exception):
    """The site cannot be built as it is; the message names the page."""


def page_places(root: Path = ROOT) -> dict[PurePosixPath, PurePosixPath]:
    """Every page of the repository → its place on the site."""
    places = {PurePosixPath(old): PurePosixPath(new) for old, new in MOVED.items()}
    for page in sorted((root / "docs").rglob("*.md")):
        path = PurePosixPath(page.relative_to(root).as_posix())
        places.setdefault(path, path.relative_to("docs"))
    for folder, shelf in (("plugins", "methods"), ("examples", "examples")):
        for page in sorted((root / folder).glob("*/README.md")):
            name = PurePosixPath(page.relative_to(root).as_posix())
            places[name] = PurePosixPath(shelf, f"{page.parent.name}.md")
    return places


def _check_formulas(source: PurePosixPath, prose: str) -> str:
    """Tried here, since Zensical would only say that the page does not exist."""
    for tex, display in formulas(prose):
        try:
            mathml(tex, display=display)
        except Exception as error:  # latex2mathml has many
            raise SiteError(f"{source}: {error or type(error).__name__}: ${tex}$") from error
    return prose


class Sources:
    """The site's sources in a folder of their own.

    Attributes:
        places: pages of the repository → places on the site.
        folder: where everything is written.
        source_url: address of the repository's files, or empty.
    """

    def __init__(self, folder: Path, source_url: str = "", root: Path = ROOT):
        self.root, self.folder, self.source_url = root, folder, source_url.rstrip("/")
        self.places = page_places(root)
        self._shown: set[PurePosixPath] = set()

    def write(self, addenda: dict[PurePosixPath, str], generated: dict[str, str]) -> None:
        """All pages, pictures and shown files.

        Args:
            addenda: text to append to pages, by place on the site.
            generated: further pages, by place on the site.

        Raises:
            SiteError: a link leads nowhere.
        """
        for source, place in self.places.items():
            text = without_comments((self.root / source).read_text("utf-8"))
            text = rewrite(text, self._changer(source, place))
            outside_code(text, partial(_check_formulas, source))
            self._put(place, text + addenda.get(place, ""))
        for name, text in generated.items():
            self._put(PurePosixPath(name), text)
        for path in sorted((self.root / "docs").rglob("*")):
            if path.suffix in COPIED:
                target = self.folder / path.relative_to(self.root / "docs")
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)

    def _changer(self, source: PurePosixPath, place: PurePosixPath) -> Callable[[str], str]:
        def changed(target: str) -> str:
            goal = resolved(source, target)
            if goal not in self.places and PurePosixPath(goal, "README.md") in self.places:
                goal = goal / "README.md"
            if goal in self.places:
                return relative(place, self.places[goal])
            if goal.parts[0] == "docs" and goal.suffix in COPIED:
                return relative(place, goal.relative_to("docs"))
            if not (self.root / goal).exists():
                raise SiteError(f"{source}: {target}: no such file")
            if self.source_url:
                return f"{self.source_url}/{goal}"
            return relative(place, self._show(goal))

        return changed

    def _show(self, path: PurePosixPath) -> PurePosixPath:
        """A page with a file of the repository, or with the names of a folder's files."""
        place = PurePosixPath("source", f"{path}.md")
        if path not in self._shown:
            self._shown.add(path)
            self._put(place, f"{_HIDDEN}# {path}\n\n{self._content(path)}")
        return place

    def _content(self, path: PurePosixPath) -> str:
        file = self.root / path
        if file.is_dir():
            inside = sorted(
                each for each in file.rglob("*") if each.is_file() and "__pycache__" not in each.parts
            )
            return "".join(f"- `{each.relative_to(self.root).as_posix()}`\n" for each in inside)
        language = LANGUAGES.get(path.suffix, "text")
        return f"````{language}\n{file.read_text('utf-8').rstrip()}\n````\n"

    def _put(self, place: PurePosixPath, text: str) -> None:
        target = self.folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, "utf-8")

"""A second look at the built pages: every local target is there, and nothing is loaded from elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADS = {"img": "src", "script": "src", "source": "src", "iframe": "src", "video": "src", "link": "href"}
"""What a browser fetches by itself, by tag; ``a`` is followed only by people."""
_QUIET_LINKS = {"canonical", "prev", "next", "edit"}


class _Page(HTMLParser):
    def __init__(self, text: str):
        super().__init__(convert_charrefs=True)
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value for key, value in attrs if value}
        self.ids |= {given[key] for key in ("id", "name") if key in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag in _LOADS and _LOADS[tag] in given and given.get("rel") not in _QUIET_LINKS:
            self.loads.append(given[_LOADS[tag]])


def problems(site: Path) -> list[str]:
    """One line per broken local link, missing anchor or file, and per request that would leave the site."""
    pages = {
        path: _Page(path.read_text("utf-8"))
        for path in sorted(site.rglob("*.html"))
        if path.name != "404.html"
    }
    return [line for path in pages for line in _of_page(site, path, pages)]


def _of_page(site: Path, path: Path, pages: dict[Path, _Page]) -> Iterator[str]:
    name = path.relative_to(site)
    for target in pages[path].loads:
        if urlsplit(target).netloc:
            yield f"{name}: loads {target} from elsewhere"
    for target in [*pages[path].links, *pages[path].loads]:
        parts = urlsplit(target)
        if parts.scheme or parts.netloc:
            continue
        goal = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        goal = goal / "index.html" if goal.is_dir() else goal
        if not goal.is_file():
            yield f"{name}: {target}: no such file"
        elif parts.fragment and goal in pages and unquote(parts.fragment) not in pages[goal].ids:
            yield f"{name}: {target}: no such heading"

"""The documents as data: fenced blocks with their test marker, headings, links and commands."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
INDEX = ROOT / "docs" / "README.md"
FIRST_STEPS = ROOT / "docs" / "first-steps.md"
HOOKS = ROOT / "docs" / "hooks.md"

_MARKER = re.compile(r"<!-- test: (?P<kind>\w+) ?(?P<arguments>.*?) *-->")
_FENCE = re.compile(r"```(?P<language>\w*)")
_LINK = re.compile(r"(?<!!)\[[^\]]*\]\((?P<target>[^)\s]+)\)|!\[[^\]]*\]\((?P<image>[^)\s]+)\)")
_SPAN = re.compile(r"(?<!`)`(?P<code>[^`\n]+)`(?!`)")


@dataclass(frozen=True)
class Block:
    """One fenced block.

    Attributes:
        page, line: where its fence stands.
        language: after the opening fence.
        text: its lines.
        kind, arguments: of the comment ``<!-- test: KIND ARGUMENTS -->`` right above, else empty.
    """

    page: Path
    line: int
    language: str
    text: str
    kind: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def pages() -> list[Path]:
    """Every Markdown file that is ours."""
    folders = ("plugins", "examples")
    below = (page for folder in folders for page in (ROOT / folder).glob("*/*.md"))
    places = (ROOT.glob("*.md"), (ROOT / "docs").rglob("*.md"), below)
    return sorted(page for place in places for page in place)


def blocks(page: Path, kind: str | None = None) -> list[Block]:
    """The fenced blocks of a page, those with that test marker only if ``kind`` is given."""
    found = list(_blocks(page))
    return found if kind is None else [block for block in found if block.kind == kind]


def _blocks(page: Path) -> Iterator[Block]:
    lines = page.read_text("utf-8").splitlines()
    i = 0
    while i < len(lines):
        fence = _FENCE.fullmatch(lines[i].strip())
        if fence is None:
            i += 1
            continue
        marker = _MARKER.fullmatch(lines[i - 1].strip()) if i else None
        end = next(j for j in range(i + 1, len(lines)) if lines[j].strip() == "```")
        yield Block(
            page,
            i + 1,
            fence["language"],
            "\n".join(lines[i + 1 : end]) + "\n",
            marker["kind"] if marker else "",
            tuple(marker["arguments"].split()) if marker else (),
        )
        i = end + 1


def prose(page: Path) -> str:
    """The page without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Anchors of the headings, made as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), flags=re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.strip().replace(" ", "-") for heading in plain}


def links(page: Path) -> list[str]:
    """Targets of links and images."""
    return [match["target"] or match["image"] for match in _LINK.finditer(prose(page))]


def spans(page: Path) -> list[str]:
    """Inline code."""
    return [match["code"] for match in _SPAN.finditer(prose(page))]


def commands(page: Path, program: str = "apil") -> list[list[str]]:
    """Words of every ``apil …`` in shell and console blocks and in inline code; or of another ``program``."""
    shell = [b.text for b in blocks(page) if b.language in ("sh", "bash", "console")]
    lines = [line.removeprefix("$ ").split(" #")[0] for text in shell for line in text.splitlines()]
    found = [code.split() for code in [*lines, *spans(page)]]
    name = program.split()
    return [words[len(name) :] for words in found if words[: len(name)] == name and len(words) > len(name)]


def sections(page: Path, level: int = 2) -> dict[str, str]:
    """Text below each heading of that level, by the heading without backticks."""
    parts = re.split(rf"^{'#' * level} (.+)$", page.read_text("utf-8"), flags=re.MULTILINE)[1:]
    return {title.strip("` "): text for title, text in zip(parts[::2], parts[1::2], strict=True)}

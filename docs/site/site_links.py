"""Relative links of Markdown pages: found outside code, and written anew for a page's place on the site."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import PurePosixPath

_CODE = re.compile(
    r"^ *(?P<fence>```+|~~~+).*?^ *(?P=fence)[ \t]*$"
    r"|(?<!`)(?P<ticks>`+)(?!`)(?:(?!\n\s*\n).)+?(?<!`)(?P=ticks)(?!`)",
    re.M | re.S,
)
"""Fenced blocks, and inline code, which does not reach over an empty line."""

_LINK = re.compile(r"(?P<before>!?\[(?:[^\[\]]|\[[^\]]*\])*\]\()(?P<target>[^)\s]+)(?P<after>\))")
_COMMENT = re.compile(r"<!--.*?-->\n?", re.S)
_ABROAD = re.compile(r"[a-z][a-z0-9+.-]*:|#|//", re.I)


def outside_code(text: str, change: Callable[[str], str]) -> str:
    """``text`` with ``change`` applied to whatever is in neither fences nor inline code."""
    parts, end = [], 0
    for code in _CODE.finditer(text):
        parts += [change(text[end : code.start()]), code[0]]
        end = code.end()
    return "".join([*parts, change(text[end:])])


def without_comments(text: str) -> str:
    """The page without HTML comments (markers of tests and of generated tables)."""
    return outside_code(text, lambda prose: _COMMENT.sub("", prose))


def rewrite(text: str, change: Callable[[str], str]) -> str:
    """The page with every relative target of a link or an image changed.

    Labels may hold inline code, so the whole text is searched; links that begin inside code stay.

    Args:
        text: Markdown.
        change: from the target without its anchor to the new one.
    """
    hidden = [code.span() for code in _CODE.finditer(text)]

    def one(link: re.Match[str]) -> str:
        if any(start <= link.start() < end for start, end in hidden) or _ABROAD.match(link["target"]):
            return link[0]
        path, mark, anchor = link["target"].partition("#")
        return f"{link['before']}{change(path)}{mark}{anchor}{link['after']}"

    return _LINK.sub(one, text)


def resolved(page: PurePosixPath, target: str) -> PurePosixPath:
    """Where a relative ``target`` on ``page`` leads, from the same root as ``page``."""
    return PurePosixPath(os.path.normpath(page.parent / target))


def relative(page: PurePosixPath, target: PurePosixPath) -> str:
    """The link from ``page`` to ``target``, both from the same root."""
    return PurePosixPath(os.path.relpath(target, page.parent)).as_posix()

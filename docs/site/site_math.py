"""Markdown extension: ``$…$`` and ``$$…$$`` become MathML, which browsers draw without a script."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree.ElementTree import Element

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor
from markdown.util import AtomicString

DISPLAY = r"(?<![\\$])\$\$(?P<tex>[^$]+?)\$\$(?!\$)"
INLINE = r"(?<![\\$])\$(?P<tex>[^\s$](?:[^$\n]*?[^\s$\\])?)\$(?![\d$])"
"""As GitHub reads it: no space inside the dollars, no digit after them (so ``5 $ to 10 $`` stays text)."""


_BARS = re.compile(r"(?P<size>\\[bB]igg?[lrm]?)\s*\\(?:[lr]?(?P<double>Vert)|\||[lr]?vert)(?![A-Za-z])")
_SPACED = re.compile(r"<mi>(log|ln|exp)</mi>(?=<m(?!o))")
_LIMIT = re.compile(r"<msub>(<mo>(?:max|min|sup|inf)</mo><m[in][^>]*>[^<]*</m[in]>)</msub>")
_SCRIPT = re.compile(r'<mi mathvariant="script">([A-Z])</mi>')
_IRREGULAR = dict(zip("BEFHILMR", "ℬℰℱℋℐℒℳℛ", strict=True))


def mathml(tex: str, *, display: bool) -> str:
    """One formula as MathML.

    Raises:
        ValueError: a macro is unknown, which latex2mathml itself would print as it stands.
    """
    made = convert(_BARS.sub(_bar, tex), display="block" if display else "inline")
    left = re.search(r"\\[A-Za-z|]+", made)
    if left:
        raise ValueError(f"unknown TeX {left[0]} in {tex!r}")
    made = _SPACED.sub(r'<mi>\1</mi><mspace width="0.167em"/>', made)
    made = _SCRIPT.sub(lambda found: f"<mi>{_script(found[1])}</mi>", made)
    return _LIMIT.sub(r"<munder>\1</munder>", made) if display else made


def _bar(found: re.Match[str]) -> str:
    """Large bars by the character: latex2mathml knows their names at normal size only."""
    return found["size"] + ("|" if found[0].endswith("vert") and not found["double"] else "‖")


def _script(letter: str) -> str:
    """The calligraphic letter itself: browsers ignore the attribute."""
    return _IRREGULAR.get(letter) or chr(0x1D49C + ord(letter) - ord("A"))


def formulas(text: str) -> Iterator[tuple[str, bool]]:
    """TeX of every formula in a piece of Markdown without code, and whether it is displayed."""
    for found in re.finditer(DISPLAY, text):
        yield found["tex"].strip(), True
    for found in re.finditer(INLINE, re.sub(DISPLAY, "", text)):
        yield found["tex"].strip(), False


class _Formula(InlineProcessor):
    """Replaces one kind of formula by a piece of finished HTML."""

    def __init__(self, pattern: str, md: Markdown, *, display: bool):
        super().__init__(pattern, md)
        self.display = display

    def handleMatch(  # type: ignore[override]  # noqa: N802  (the library's name)
        self, match: re.Match[str], data: str
    ) -> tuple[Element | str, int, int]:
        made = mathml(match["tex"].strip(), display=self.display)
        if self.display:
            box = Element("span", {"class": "formula"})
            box.text = AtomicString(self.md.htmlStash.store(made))
            return box, match.start(0), match.end(0)
        return self.md.htmlStash.store(made), match.start(0), match.end(0)


class MathExtension(Extension):
    """Formulas are found after code spans (190) and before backslash escapes (180)."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802  (the library's name)
        md.inlinePatterns.register(_Formula(DISPLAY, md, display=True), "display formula", 189)
        md.inlinePatterns.register(_Formula(INLINE, md, display=False), "inline formula", 188)


def makeExtension(**options: object) -> MathExtension:  # noqa: N802  (the library's name)
    """What Python-Markdown calls."""
    return MathExtension(**options)

"""Third-party text for terminals: control characters and unprintable ones are shown as ``\\uXXXX``."""

from __future__ import annotations

import re

_UNSEEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters except tab and newline, bidirectional controls, surrogates."""


def visible(text: str) -> str:
    """``text`` without control characters; in a JSON text it means the same as before."""
    return _UNSEEN.sub(lambda found: f"\\u{ord(found[0]):04x}", text)

"""What a safetensors file says of where it came from. Imports no torch."""

from __future__ import annotations

import json
from collections.abc import Mapping


def provenance_of(metadata: Mapping[str, str]) -> dict[str, str]:
    """The JSON object under ``provenance`` in a file's metadata, values as text, or nothing."""
    try:
        told = json.loads(metadata.get("provenance", "{}"))
    except json.JSONDecodeError:
        return {}
    return {key: str(value) for key, value in told.items()} if isinstance(told, dict) else {}

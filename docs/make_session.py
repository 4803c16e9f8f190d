"""Run the notebook of a session and write its transcript: ``python docs/make_session.py``.

It trains on the toy game for about a minute, in a temporary folder; docs/results/session.md is what it shows.
"""

from __future__ import annotations

import base64
import re
import shutil
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "examples" / "notebook" / "session.ipynb"
PAGE = ROOT / "docs" / "results" / "session.md"
_HEADER = """\
<!-- made by make_session.py from examples/notebook/session.ipynb -->
"""


def executed(folder: Path) -> Any:
    """The notebook with its outputs, run from top to bottom in ``folder``; raises where a cell does."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    resources = {"metadata": {"path": str(folder)}}
    return NotebookClient(notebook, timeout=600, kernel_name="python3", resources=resources).execute()


def markdown(notebook: Any, pictures: Path) -> str:
    """The notebook as Markdown; its pictures become files ``1.png``, … in ``pictures``."""
    parts = [_HEADER]
    count = 0
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source + "\n")
            continue
        parts.append(f"```python\n{cell.source}\n```\n")
        for output in cell.outputs:
            data = output.get("data", {})
            if shown := re.match('<img src="data:image/png;base64,([^"]+)', data.get("text/html", "")):
                count += 1
                file = pictures / f"{count}.png"
                with Image.open(BytesIO(base64.b64decode(shown[1]))) as picture:
                    picture.thumbnail((1000, 1000))
                    picture.convert("RGB").quantize(64).save(file, optimize=True)  # a quarter of the size
                parts.append(f"![]({pictures.name}/{file.name})\n")
            elif output.get("name") != "stderr" and (text := data.get("text/plain", output.get("text", ""))):
                parts.append(f"```text\n{re.sub(r'[ ]+$', '', text.rstrip(), flags=re.M)}\n```\n")
    return "\n".join(parts)


def main() -> None:
    """Run it and write the page."""
    with tempfile.TemporaryDirectory() as name:
        notebook = executed(Path(name))
    pictures = PAGE.with_suffix("")
    shutil.rmtree(pictures, ignore_errors=True)
    pictures.mkdir()
    PAGE.write_text(markdown(notebook, pictures), "utf-8")


if __name__ == "__main__":
    main()

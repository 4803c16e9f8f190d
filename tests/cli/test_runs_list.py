"""``apil runs list``: each file of a run is read once, links are followed, a mistyped root is an error."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path

import pytest

from apil_core.config import layers
from cli.cli_helpers import Apil

READ: Counter[str] = Counter()
_HOOKED: list[bool] = []


def _opened(event: str, arguments: tuple[object, ...]) -> None:
    if event == "open" and _HOOKED:
        READ[Path(str(arguments[0])).name] += 1


def test_each_file_is_read_once(apil: Apil, trained: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parsed: list[str] = []
    parse = layers.parse_yaml
    monkeypatch.setattr(
        layers, "parse_yaml", lambda text, origin: parsed.append(origin) or parse(text, origin)
    )
    sys.addaudithook(_opened)
    _HOOKED.append(True)
    listed = apil("runs", "list", trained, "--json")
    _HOOKED.clear()
    assert json.loads(listed.out)[0]["method"] == "adrl"
    names = ("config.yaml", "config.json", "metrics.jsonl", "result.json")
    assert {name: READ[name] for name in names} == dict.fromkeys(names, 1)
    assert parsed == []
    # what was changed by hand counts, not its copy
    config = trained / "config.yaml"
    config.write_text(config.read_text().replace("\nseed: 0\n", "\nseed: 7\n"))
    assert json.loads(apil("runs", "list", trained, "--json").out)[0]["seed"] == 7
    assert len(parsed) == 1
    (trained / "config.json").write_text("{")
    assert json.loads(apil("runs", "list", trained, "--json").out)[0]["seed"] == 7


def test_runs_behind_links_are_listed_once(apil: Apil, trained: Path, tmp_path: Path) -> None:
    root = tmp_path / "all"
    root.mkdir()
    (root / "a-link").symlink_to(trained)
    (root / "again").symlink_to(trained)
    (root / "a-circle").symlink_to(root)
    listed = json.loads(apil("runs", "list", root, "--json").out)
    assert [Path(run["path"]).name for run in listed] == ["a-link"]
    (root / "run").mkdir()
    (root / "run" / "config.yaml").write_text("kind: retraining\n")
    assert len(json.loads(apil("runs", "list", root, "--json").out)) == 1


def test_a_mistyped_root_is_an_error(apil: Apil) -> None:
    done = apil("runs", "list", "rums")
    assert (done.code, done.err) == (2, "apil: rums is no directory\n")
    assert apil("runs", "list").code == 0, "before the first run there are none"

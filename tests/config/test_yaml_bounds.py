"""YAML that is no settings is one line, and quickly, in files and in ``--set``."""

from __future__ import annotations

from pathlib import Path

import pytest

from apil_core import ConfigError
from apil_core.config.layers import file_layer, file_layers, parse_yaml, set_layer

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{below}'] * 10)}]\n"
    for below, name in zip("abcdefgh", "bcdefghi", strict=True)
)
BAD = {
    "aliases that multiply": (LAUGHS, "more than 20,000 values or 50 levels"),
    "an alias of itself": ("a: &a [*a]\n", "more than 20,000 values or 50 levels"),
    "brackets": ("a: " + "[" * 700, "nested too deeply"),
    "a long text": ("a: " + "x" * 3_000_000, "3,000,003 characters, settings have 200,000 at most"),
    "many keys": ("".join(f"k{i}: 1\n" for i in range(25_000)), "characters, settings have|more than 20,000"),
    "an impossible date": ("steps: 2001-99-99\n", "month must be in 1..12"),
    "no number": ("steps: !!int x\n", "invalid literal"),
    "5000 digits": ("steps: " + "9" * 5000, "4300 digits"),
    "a list as key": ("? [a, b]\n: 1\n", "line 1: a key must be one word"),
    "a mapping as key": ("? {a: b}\n: 1\n", "line 1: a key must be one word"),
    "NUL": ("steps: \0\n", "special characters are not allowed"),
    "two documents": ("a: 1\n---\nb: 2\n", "my.yaml:2: a second document begins here: settings are one"),
    "a tuple": ("a: !!python/tuple [1, 2]\n", r"a tag \(!…\) is no setting: a list is written \[1, 2\]"),
}
OF_FILES = {
    "a deeper key": ("a: 1\n  b: 2\n", ":2: a key inside the value above it: check the indent"),
    "an indent between": ("a:\n    b: 1\n  c: 2\n", ":3: the indent fits no line above"),
    "a tab": ("a:\n\tb: 1\n", ":2: a tab: indent with spaces"),
    "presets that are none": ("\npresets: [papr]\n", r":2: presets: unknown preset 'papr' \(did you mean"),
    "presets by number": ("presets: [1]\n", r":1: presets: should be a list of names, such as \[paper\]"),
    "presets with keys": ("presets: {a: b}\n", r":1: presets: should be a list of names"),
}


@pytest.mark.parametrize("name", BAD)
def test_it_is_one_line(tmp_path: Path, name: str) -> None:
    text, reason = BAD[name]
    path = tmp_path / "my.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=reason) as caught:
        file_layer(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(ConfigError, match="^--set game.x=") as caught:
        set_layer(f"game.x={text.removeprefix('steps: ')}")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("name", OF_FILES)
def test_of_a_file_the_line_is_named(tmp_path: Path, name: str) -> None:
    text, reason = OF_FILES[name]
    path = tmp_path / "my.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=f"^{path}{reason}") as caught:
        file_layers(path)
    assert "\n" not in str(caught.value)


def test_aliases_of_settings_are_read() -> None:
    data, lines = parse_yaml("a: &a {x: 1}\nb: *a\n", "t")
    assert data == {"a": {"x": 1}, "b": {"x": 1}}
    assert lines["b", "x"] == 1

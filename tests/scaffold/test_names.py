"""Names of new plugins: what they become, and which are refused."""

from __future__ import annotations

import pytest

from apil_core import ConfigError
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.plugins.scaffold.names import LONGEST, new_names


@pytest.fixture(scope="module")
def plugins() -> PluginRegistry:
    return discover()


@pytest.mark.parametrize("typed", ["my-idea", "my_idea"])
def test_hyphens_and_underscores_give_the_same_names_spelt_as_the_built_in_ones_are(plugins, typed):
    method, game = new_names("method", typed, plugins), new_names("game", typed, plugins)
    assert (method.registered, game.registered) == ("my_idea", "my-idea")
    assert new_names("victim", typed, plugins).registered == "my-idea"
    assert (method.package, method.distribution, method.camel) == ("apil_my_idea", "apil-my-idea", "MyIdea")


@pytest.mark.parametrize(
    ("typed", "instead"),
    [
        *(("MyIdea", "my-idea"), ("my idea", "my-idea"), ("my--idea", "my-idea"), ("-idea-", "idea")),
        *(("2fast", "fast"), ("été", "t"), ("../evil", "evil"), ("a.b", "a-b"), ("CLASS", "my-method")),
        *(("", "my-method"), ("123", "my-method"), ("a-1\n", "a")),
    ],
)
def test_what_is_no_name_is_told_with_one_that_would_do(plugins, typed, instead):
    with pytest.raises(ConfigError) as caught:
        new_names("method", typed, plugins)
    text = str(caught.value)
    assert repr(typed) in text
    assert text.endswith(f"e.g. {instead!r}")
    assert "\n" not in text
    assert new_names("method", instead, plugins).typed == instead


@pytest.mark.parametrize(
    ("kind", "typed", "reason"),
    [
        ("method", "e-apil", "a method named 'e_apil' exists already; try 'my-e-apil'"),
        ("game", "toy_pursuit", "a game named 'toy-pursuit' exists already; try 'my-toy-pursuit'"),
        ("game", "scripted", "a victim scheme named 'scripted' exists already; try 'my-scripted'"),
        ("victim", "torch-export", "a victim scheme named 'torch-export' exists already"),
        ("victim", "games", "a plugin named 'games' exists already; try 'my-games'"),
        ("method", "class", "'class' is a word of Python's own; try 'my-class'"),
        ("method", "core", "'core': a Python module 'apil_core' exists here already; try 'my-core'"),
        ("victim", "numpy", "'numpy': a Python module 'numpy' exists here already; try 'my-numpy'"),
        ("game", "a" * (LONGEST + 1), "31 characters long; a plugin's name has at most 30"),
    ],
)
def test_a_name_that_is_taken_says_by_what(plugins, kind, typed, reason):
    with pytest.raises(ConfigError) as caught:
        new_names(kind, typed, plugins)
    assert reason in str(caught.value)


def test_a_mere_directory_takes_no_name(plugins, tmp_path, monkeypatch):
    (tmp_path / "plainfolder").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    assert new_names("method", "plainfolder", plugins).package == "apil_plainfolder"

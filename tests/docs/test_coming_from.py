"""docs/coming-from.md: defaults of Stable-Baselines3 and ours are those of the code, commands are ours."""

from __future__ import annotations

import inspect
import json
import re

import pytest

from apil_core import RunConfig
from apil_core.config.resolve import flatten
from docs.pages import ROOT, sections

PAGE = ROOT / "docs" / "coming-from.md"


def column(number: int) -> dict[str, str]:
    """Names and defaults in a column of the table of hyperparameters."""
    rows = [line.split("|")[number] for line in sections(PAGE)["Hyperparameters"].splitlines() if "|" in line]
    return dict(
        found.groups()
        for cell in rows
        if (found := re.fullmatch(r" `([\w.]+)` ([\w., ]+?)(?: \(.*)? ", cell))
    )


def test_our_defaults_are_those_of_the_page() -> None:
    stated = column(4)
    assert len(stated) == 15
    ours = flatten(RunConfig().model_dump(mode="json"), "")
    assert stated == {key: json.dumps(ours[key]).strip("[]") for key in stated}


def test_their_defaults_are_those_of_the_page() -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    defaults = inspect.signature(sb3.PPO.__init__).parameters
    policy = inspect.signature(sb3.ppo.MlpPolicy.__init__).parameters
    stated = {key: value for key, value in column(1).items() if key not in ("n_envs", "net_arch")}
    assert len(stated) == 13
    for key, value in stated.items():
        assert str(({**policy, **defaults})[key].default) == value, key

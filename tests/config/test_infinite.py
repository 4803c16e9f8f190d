"""Infinite settings survive every file they are written to."""

from __future__ import annotations

import importlib
import json
import math
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

import apil_core
from apil_core import RunConfig
from apil_core.common.documents import plain
from apil_core.config.resolve import dump_yaml, load_resolved, resolve
from apil_core.plugins.registry import default_plugins
from apil_core.training.storage import checkpoint

# its code is not looked at; in a file, a name that other tests use would have to be trusted there
ENDLESS = ["env=pettingzoo:nowhere:Endless", "victim=random"]


def test_an_infinite_option_of_a_game(tmp_path: Path) -> None:
    plugins = default_plugins()
    config = resolve(sets=[*ENDLESS, "game.kwargs={length: .inf, more: [-.inf, {x: .inf}]}"], plugins=plugins)
    kwargs = {"length": math.inf, "more": [-math.inf, {"x": math.inf}]}
    assert config.game["kwargs"] == kwargs
    (tmp_path / "config.yaml").write_text(dump_yaml(config, plugins))
    assert load_resolved(tmp_path / "config.yaml").game["kwargs"] == kwargs
    assert RunConfig.model_validate_json(config.model_dump_json()) == config
    assert json.loads(json.dumps(config.model_dump(mode="json")))["game"]["kwargs"] == kwargs
    checkpoint.save(tmp_path / "c.pt", {"config": config.model_dump(mode="json")})
    assert checkpoint.read(tmp_path / "c.pt")["config"]["game"]["kwargs"] == kwargs


def test_options_of_a_model_that_is_not_ours() -> None:
    class Theirs(BaseModel):
        limit: float = math.inf
        more: dict[str, Any] = {}

    assert plain(Theirs(more={"x": -math.inf})) == {"limit": math.inf, "more": {"x": -math.inf}}


def models(kind: type[BaseModel] = BaseModel) -> Iterator[type[BaseModel]]:
    for module in pkgutil.walk_packages(apil_core.__path__, "apil_core."):
        if not module.name.startswith("apil_core.cli.__main__"):
            importlib.import_module(module.name)
    classes = kind.__subclasses__()
    while classes:
        found = classes.pop()
        classes += found.__subclasses__()
        if found.__module__.startswith("apil_core."):
            yield found


def test_models_with_untyped_parts_keep_infinite_numbers() -> None:
    untyped = [
        each for each in models() if any("Any" in str(f.annotation) for f in each.model_fields.values())
    ]
    assert RunConfig in untyped
    assert len(untyped) > 6
    lossy = [each for each in untyped if each.model_config.get("ser_json_inf_nan") != "constants"]
    assert lossy == []


@pytest.mark.parametrize("value", [math.inf, -math.inf])
def test_results_keep_the_options_of_their_game(value: float) -> None:
    from apil_core.evaluation.results import MatchSetup

    made = MatchSetup.model_construct(game_options={"x": value})
    assert json.loads(made.model_dump_json())["game_options"] == {"x": value}

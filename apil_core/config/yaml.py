"""A config as commented YAML, printed by ``apil config show`` and stored in every run directory."""

from __future__ import annotations

from io import StringIO
from typing import Any

from pydantic import BaseModel
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from apil_core.api.config import RunConfig
from apil_core.config.schema import full_model
from apil_core.plugins.discovery import PluginRegistry


def dump_yaml(config: RunConfig, plugins: PluginRegistry | None = None) -> str:
    """YAML with every key, each below a comment that describes it.

    Args:
        config: to be written; :func:`apil_core.config.resolve.load_resolved` reads it back equal.
        plugins: also comments the options of methods, observers and game.
    """
    model: type[BaseModel] = type(config)
    if plugins is not None and config.method in plugins.methods and plugins.has_game(config.env):
        parts = plugins.run_plugins(config.method, config.observers)
        model = full_model(plugins, parts, config.env)
    return commented_yaml(config.model_dump(mode="json"), model)


def commented_yaml(data: dict[str, Any], model: type[BaseModel]) -> str:
    """YAML of ``data``, each key under its description in ``model``."""
    yaml = YAML()
    yaml.width = 1000  # never fold a value
    yaml.representer.add_representer(type(None), _null)
    buffer = StringIO()
    yaml.dump(_commented(data, model, 0), buffer)
    return buffer.getvalue()


def _commented(data: dict[str, Any], model: type[BaseModel] | None, indent: int) -> CommentedMap:
    mapping = CommentedMap()
    for key, value in data.items():
        info = model.model_fields.get(key) if model else None
        annotation = info.annotation if info else None
        section = annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else None
        comment = (info.description if info else None) or (section.__doc__ if section else None)
        mapping[key] = _node(value, section, indent)
        if comment:
            first_line = comment.strip().split("\n")[0].replace("``", "")
            mapping.yaml_set_comment_before_after_key(key, before=first_line, indent=indent)
    return mapping


def _node(value: Any, section: type[BaseModel] | None, indent: int) -> Any:
    if isinstance(value, dict) and value:
        return _commented(value, section, indent + 2)
    if isinstance(value, list):
        sequence = CommentedSeq(value)
        sequence.fa.set_flow_style()
        return sequence
    return value


def _null(representer: Any, _: None) -> Any:
    return representer.represent_scalar("tag:yaml.org,2002:null", "null")

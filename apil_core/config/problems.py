"""Error messages for a config, one line per mistake: ``origin: key: what is wrong (did you mean …)``."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from apil_core.common.annotations import section_of
from apil_core.common.errors import ConfigError, UnknownNameError, suggest
from apil_core.config.layers import Key

Model = TypeVar("Model", bound=BaseModel)

_SHOULD = {
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "should be a whole number"),
    **dict.fromkeys(("tuple_type", "list_type"), "should be a list, such as [64, 64]"),
}
"""What pydantic's kinds of errors ask for, in the words of a settings file."""


@dataclass(frozen=True)
class Problem:
    """One mistake: at which key, and what is wrong with it."""

    key: Key
    reason: str


def raise_problems(problems: Sequence[Problem], origins: Mapping[Key, str]) -> None:
    """Raise one ``ConfigError`` with a line per problem, in the order the keys were written."""
    if not problems:
        return
    order = {key: index for index, key in enumerate(origins)}
    ranked = sorted(problems, key=lambda problem: order.get(_written(problem, origins) or (), -1))
    raise ConfigError("\n".join(_line(problem, origins) for problem in ranked))


def problems_of(error: ValidationError, model: type[BaseModel]) -> list[Problem]:
    """pydantic's errors, reworded."""
    found = error.errors()
    parts = {tuple(item["loc"][:-1]) for item in found}
    # pydantic also reports a tuple with wrong parts as too short
    shown = [item for item in found if item["type"] != "too_short" or tuple(item["loc"]) not in parts]
    return [Problem(tuple(item["loc"]), _reason(dict(item), model)) for item in shown]


def validated(model: type[Model], data: Mapping[str, Any], origins: Mapping[Key, str]) -> Model:
    """``data`` as that model.

    Raises:
        ConfigError: one line per mistake.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise_problems(problems_of(error, model), origins)
        raise


def unknown_name(key: Key, kind: str, name: str, known: Sequence[str]) -> Problem:
    """A value that should be one of the ``known`` names."""
    return Problem(key, str(UnknownNameError(kind, name, known)))


def _line(problem: Problem, origins: Mapping[Key, str]) -> str:
    written = _written(problem, origins)
    origin = origins[written] if written else origins.get((), "config")
    dotted = ".".join(map(str, problem.key))
    is_flag = origin.startswith("--") and not origin.startswith("--set ")
    named = (is_flag and written == problem.key) or origin.startswith(f"--set {dotted}=")
    return f"{origin}: {problem.reason}" if named or not dotted else f"{origin}: {dotted}: {problem.reason}"


def _written(problem: Problem, origins: Mapping[Key, str]) -> Key | None:
    """The key in ``origins`` that a message names: the problem's own, one below it, one above it, or, for
    a rule over several keys, the last set of the keys in the reason."""
    if problem.key in origins:
        return problem.key
    for key in reversed(list(origins)):
        below = problem.key and key[: len(problem.key)] == problem.key
        named = not problem.key and ".".join(map(str, key)) in problem.reason.split()
        if below or named:
            return key
    above = (problem.key[:length] for length in range(len(problem.key) - 1, 0, -1))
    return next((key for key in above if key in origins), None)


def _reason(item: dict[str, Any], model: type[BaseModel]) -> str:
    kind, loc = item["type"], tuple(item["loc"])
    if kind == "extra_forbidden":
        return f"unknown key{_suggest_key(model, loc)}"
    if kind == "missing":
        return "missing"
    if kind in ("model_type", "dict_type"):
        return f"should be a section of keys and values, got {item['input']!r}"
    if kind == "value_error":
        return str(item["ctx"]["error"])
    reason = _SHOULD.get(kind) or item["msg"].removeprefix("Input ")
    reason = reason[0].lower() + reason[1:]
    value = item["input"]
    shown = f", got {value!r}" if isinstance(value, (str, int, float, bool, type(None))) else ""
    return f"{reason}{shown}{_suggest_value(item)}"


def _suggest_value(item: dict[str, Any]) -> str:
    if item["type"] != "literal_error":
        return ""
    choices = [choice.strip("'") for choice in item["ctx"]["expected"].replace(" or ", ", ").split(", ")]
    close = difflib.get_close_matches(str(item["input"]), choices, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _suggest_key(model: type[BaseModel], loc: Key) -> str:
    """Near names in the same section; else the same name in another section."""
    section = model_at(model, loc[:-1])
    known = list(section.model_fields) if section else []
    name = str(loc[-1])
    elsewhere = [key for key in _dotted_keys(model) if key.rpartition(".")[2] == name]
    close = difflib.get_close_matches(name, known, n=1) or elsewhere
    return f" (did you mean {close[0]!r}?)" if close else suggest(name, known)


def model_at(model: type[BaseModel], loc: Key) -> type[BaseModel] | None:
    """The model of the section at ``loc``, or ``None`` where there is none."""
    annotation: Any = model
    for part in loc:
        if (section := section_of(annotation)) is not None:
            info = section.model_fields.get(str(part))
            annotation = info.annotation if info else None
        else:  # sections by name, such as a matrix's scores
            annotation = get_args(annotation)[1] if get_origin(annotation) is dict else None
    return section_of(annotation)


def _dotted_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for name, info in model.model_fields.items():
        keys.append(prefix + name)
        if (section := section_of(info.annotation)) is not None:
            keys += _dotted_keys(section, f"{prefix}{name}.")
    return keys

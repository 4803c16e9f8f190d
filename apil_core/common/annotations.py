"""What an annotation of a config's field allows."""

from __future__ import annotations

from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel


def alternatives(annotation: Any) -> tuple[Any, ...]:
    """The alternatives of an annotation: those of ``Annotated[int, …] | None`` are int and None."""
    if get_origin(annotation) is Annotated:
        return alternatives(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return tuple(kind for part in get_args(annotation) for kind in alternatives(part))
    return (annotation,)


def section_of(annotation: Any) -> type[BaseModel] | None:
    """The model behind ``Model`` or ``Model | None``; ``None`` for all else, lists of models too."""
    kinds = alternatives(annotation)
    found = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]
    return found[0] if len(found) == 1 else None

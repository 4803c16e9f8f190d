"""Results that are one JSON file each."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import to_jsonable_python

from apil_core.common.errors import ConfigError
from apil_core.common.files import write_atomically

EXACT = ConfigDict(ser_json_inf_nan="constants")
"""For models with untyped parts: infinite numbers stay, which pydantic would make null."""


def plain(model: BaseModel) -> dict[str, Any]:
    """A model as JSON values, with infinite numbers also in third-party models."""
    content: dict[str, Any] = to_jsonable_python(model.model_dump())
    return content


class JsonDocument(BaseModel):
    """Result of one command, with everything it depends on.

    Attributes:
        maker: the command.
        created: when, ISO 8601 with time zone.
        command: what made it.
    """

    model_config = EXACT

    maker: ClassVar[str]
    created: str
    command: list[str] = []

    def write(self, path: Path) -> None:
        """Write it as JSON, whole or not at all.

        Raises:
            RunDirError: the file cannot be written; an existing one is unchanged.
        """
        text = self.model_dump_json(indent=1)
        write_atomically(path, lambda file: file.write(text.encode()))

    @classmethod
    def stored(cls, path: Path) -> Self | None:
        """Like :meth:`read`; ``None`` if there is no file."""
        return cls.read(path) if path.is_file() else None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a document written by :meth:`write`.

        Raises:
            ConfigError: it is not there, or something else.
        """
        try:
            return cls.model_validate_json(path.read_text("utf-8"))
        except FileNotFoundError:
            raise ConfigError(f"{path}: no such file") from None
        except (OSError, ValidationError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path}: this is no document of {cls.maker}") from error

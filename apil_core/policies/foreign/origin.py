"""The file a policy was loaded from, and errors about it. Imports no torch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from apil_core.common.errors import VictimError
from apil_core.common.files import sha256


@dataclass(frozen=True)
class Origin:
    """Origin of a policy.

    Attributes:
        name: full name of the policy, by which it can be loaded again.
        sha256: of the file.
        path: of the file, absolute.
    """

    name: str
    sha256: str
    path: Path

    @classmethod
    def of(cls, scheme: str, file: str) -> Origin:
        """The file named after ``scheme:``.

        Raises:
            VictimError: there is none.
        """
        path = Path(file).expanduser().absolute()
        try:
            return cls(f"{scheme}:{path}", sha256(path), path)
        except OSError as error:
            reason = "no such file" if isinstance(error, FileNotFoundError) else error.strerror
            raise VictimError(f"{scheme}:{file}: {path}: {reason}; expected {scheme}:FILE") from error

    def wrong(self, expected: str, found: str) -> VictimError:
        """Error about the file."""
        return VictimError(f"{self.name}: expected {expected}, found {found}")

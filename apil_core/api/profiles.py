"""Games whose physics comes in two profiles: as the game was made, and cheaper.

A profile is a named set of values for some of the game's options. Those options are ``null`` by default,
"as the profile says"; a value of their own wins. Scores keep the profile's name and all its values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any, ClassVar, Literal

from apil_core.api.config import Section

Profile = Literal["faithful", "fast"]

FAITHFUL: Profile = "faithful"
"""Default profile of a game."""

CUSTOM = "custom"
"""Name used where the values match neither profile."""


class ProfiledOptions(Section):
    """Base of the options of a game with physics profiles.

    Subclasses set :attr:`profiles` and declare, for each field of a profile, an option of that name that
    may be ``None`` and is so by default.

    Attributes:
        profiles: both profiles by name, instances of one frozen dataclass.
    """

    profiles: ClassVar[Mapping[str, Any]]

    physics: Profile = FAITHFUL
    """Physics profile: faithful (the game as it was made) or fast (cheaper physics, nearly the same game)."""

    @classmethod
    def profile_keys(cls) -> tuple[str, ...]:
        """The options set by a profile."""
        return tuple(each.name for each in fields(cls.profiles[FAITHFUL]))

    def profile_values(self) -> dict[str, Any]:
        """Value of every profile key: the profile's, unless the options state their own."""
        own = {key: getattr(self, key) for key in self.profile_keys()}
        return asdict(self.profiles[self.physics]) | {k: v for k, v in own.items() if v is not None}

    @property
    def settings(self) -> dict[str, Any]:
        """``physics``, the name of the profile these options come to (or ``"custom"``), and all values."""
        values = self.profile_values()
        names = (self.physics, *self.profiles)
        name = next((name for name in names if asdict(self.profiles[name]) == values), CUSTOM)
        return {"physics": name, **values}

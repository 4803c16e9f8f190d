"""The installed games in Gymnasium's registry, e.g. ``apil/KickAndDefend-v0``; importing this registers them.

Gymnasium 1.x reads no entry points, so ids need an import: ``gymnasium.register_envs(apil_core.gym)``, or
``gymnasium.make("apil_core.gym:apil/KickAndDefend-v0")``. Neither torch nor mujoco are imported here.
"""

from __future__ import annotations

import re

from gymnasium import register

from apil_core.plugins.registry import default_plugins

for _name, _spec in default_plugins().games.items():
    if not _spec.family and ":" not in _name:
        _words = "".join(word[:1].upper() + word[1:] for word in re.split(r"\W|_", _name))
        register(
            f"apil/{_words}-v0",
            entry_point="apil_core.games.views:OpponentInsideEnv",
            vector_entry_point="apil_core.games.vector:GameVectorEnv",
            kwargs={"game": _name},
        )

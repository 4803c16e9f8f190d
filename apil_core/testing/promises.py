"""Every promise the checks know, where it is documented, and the error for one that is broken."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from apil_core.api.hookspecs import ProcessHooks, RunHooks
from apil_core.common.errors import FAILURES, ApilError, PluginError


@dataclass(frozen=True)
class Promise:
    """One thing that is checked.

    Attributes:
        title: heading of its section in docs/testing.md.
        text: the promise in one sentence.
    """

    title: str
    text: str

    @property
    def address(self) -> str:
        """Of its section, as GitHub makes anchors."""
        kept = re.sub(r"[^\w\- ]", "", self.title.lower())
        return f"testing.md#{kept.replace(' ', '-')}"


METHOD_PROMISES = {
    "spec": Promise("Spec", "what a MethodSpec names exists, loads and is what it must be"),
    "import": Promise("Light import", "the module that registers brings in neither torch nor mujoco"),
    "options": Promise(
        "Options model",
        "options are a pydantic model that forbids unknown keys, documents each one and is valid alone",
    ),
    "marks": Promise("Marked hooks", "a function named like a hook is marked with @hookimpl"),
    "answers": Promise("Answers", "a hook that wants an answer is given one by some return statement"),
    "run": Promise("A tiny run", "it trains, and what its hooks return has the promised shape and type"),
    "calls": Promise("Calls", "hooks are called as docs/hooks.md says, and those filled are called"),
    "unchanged": Promise("Unchanged arguments", "what is handed to a hook is not changed in place"),
    "randomness": Promise("Randomness", "hooks draw from run.generator or context.generator only"),
    "state": Promise(
        "State", "state_dict holds plain data and tensors, and a fresh object that loads it gives it back"
    ),
    "seed": Promise("Seeds", "the seed decides: equal seeds give equal bits, and another one other weights"),
    "resume": Promise(
        "Resume", "a run resumed from a checkpoint ends with the bits of one that was not stopped"
    ),
    "evaluation": Promise("Without a run", "the trained adversary acts and scores without its run"),
    "blinding": Promise("Blinding", "it can be scored while the opponent is hidden from it"),
    "one game": Promise("One game", "it trains on a single game"),
    "many games": Promise("Many games", "it trains on any number of games"),
    "company": Promise("Company", "it trains beside observers, and as a method that another one requires"),
}

GAME_PROMISES = {
    "spec": Promise("Game spec", "what a GameSpec names exists, loads and is what it must be"),
    "layout": Promise("Layout", "sizes, blocks, opponent channels and causes fit each other"),
    "arrays": Promise("Arrays", "observations, rewards and flags have the promised shapes, types and values"),
    "endings": Promise("Endings", "done, winner, cause and lengths tell one story"),
    "seeds": Promise("Game seeds", "a seed gives the same games bit for bit at any number of threads"),
    "save": Promise("Saved games", "state_dict is plain data, and a game that loads it goes on bit for bit"),
    "reset": Promise("Reset", "reset(mask) starts new games in those rows and leaves the others alone"),
    "inactive": Promise("Inactive games", "games that are not active stand still and disturb nobody"),
    "ended": Promise("Ended games", "ended games stay ended until reset"),
    "bounds": Promise("Action bounds", "actions out of bounds count as those at the bounds"),
    "beside": Promise("Games beside", "how a game goes does not depend on what is played beside it"),
    "buffers": Promise(
        "Old observations", "observations keep their content until the step after the next one"
    ),
    "first": Promise("First step", "a step before any reset is an error"),
    "one": Promise("A game alone", "it can be played with num_envs=1"),
    "views": Promise("Views", "it passes PettingZoo's and Gymnasium's own checkers"),
}

VICTIM_PROMISES = {
    "load": Promise("Loading", "its name loads it, in the sizes of the seat, and its info names it again"),
    "hash": Promise("Hash", "the same name gives the same SHA-256 each time"),
    "acts": Promise("Acting", "it does what apil_core.Policy promises"),
    "same": Promise("Same actions", "loaded twice it does the same, and its saved state continues it"),
    "play": Promise("Playing", "it plays, and the same seed gives the same score"),
}

_CORE_HOOKS = tuple(
    name for place in (RunHooks, ProcessHooks) for name in vars(place) if not name.startswith("_")
)


def hook_address(hook: str) -> str:
    """Where a hook is documented."""
    return f"hooks.md#{hook}" if hook in _CORE_HOOKS else "hooks.md#hooks-of-your-own"


class ContractError(AssertionError):
    """A plugin broke a promise. The message says which, what happened, and where the promise is documented.

    Attributes:
        promise: the promise.
        address: page and section below ``docs/``.
    """

    def __init__(self, who: str, promise: Promise, happened: str, hook: str | None = None):
        self.promise = promise
        self.address = promise.address if hook is None else hook_address(hook)
        super().__init__(f"{who}: {happened}\n  contract: {promise.text}\n  docs: {self.address}")


def hook_in(message: str) -> str | None:
    """The first core hook that an error's message names, or ``None``."""
    found = re.search(rf"\b({'|'.join(_CORE_HOOKS)})\b", message)
    return found[1] if found else None


@contextmanager
def promised(who: str, promise: Promise) -> Iterator[None]:
    """Turn whatever is raised into a broken promise; a plugin's mistake gets its hook's address.

    Raises:
        ContractError: anything was raised.
    """
    try:
        yield
    except ContractError:
        raise
    except PluginError as error:
        raise ContractError(who, promise, str(error), hook_in(str(error))) from error
    except ApilError as error:
        raise ContractError(who, promise, str(error)) from error
    except FAILURES as error:
        reason = " ".join(str(error).split()) or "no message"
        raise ContractError(who, promise, f"{type(error).__name__}: {reason}") from error

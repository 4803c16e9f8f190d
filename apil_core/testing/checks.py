"""All checks, their documentation, what they are made of, and the error of a failed one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, ClassVar, TypeVar, cast

from apil_core.api.hookspecs import ProcessHooks, RunHooks
from apil_core.common.errors import ApilError, PluginError, failures, reason_of

Checks = TypeVar("Checks", bound=Callable[..., Any])


@dataclass(frozen=True)
class Check:
    """One check.

    Attributes:
        title: heading of its section in docs/testing.md.
        text: the requirement, in one sentence.
    """

    title: str
    text: str

    @property
    def address(self) -> str:
        """Page and anchor of its section, with GitHub's anchor."""
        kept = re.sub(r"[^\w\- ]", "", self.title.lower())
        return f"testing.md#{kept.replace(' ', '-')}"


METHOD_CHECKS = {
    "spec": Check("Spec", "what a MethodSpec names exists, loads and is what it must be"),
    "import": Check("Light import", "the module that registers brings in neither torch nor mujoco"),
    "options": Check(
        "Options model",
        "options are a pydantic model that forbids unknown keys, documents each one and is valid alone",
    ),
    "marks": Check("Marked hooks", "a function named like a hook is marked with @hookimpl"),
    "answers": Check("Answers", "a hook that wants an answer is given one by some return statement"),
    "run": Check("A tiny run", "it trains, and what its hooks return has the documented shape and type"),
    "calls": Check("Calls", "hooks are called as docs/hooks.md says, and those filled are called"),
    "unchanged": Check("Unchanged arguments", "what is handed to a hook is not changed in place"),
    "randomness": Check("Randomness", "hooks draw from run.generator or context.generator only"),
    "state": Check(
        "State", "state_dict holds plain data and tensors, and a fresh object that loads it gives it back"
    ),
    "seed": Check("Seeds", "the seed decides: equal seeds give equal bits, and another one other weights"),
    "resume": Check(
        "Resume", "a run resumed from a checkpoint ends with the bits of one that was not stopped"
    ),
    "evaluation": Check("Without a run", "the trained adversary acts and scores without its run"),
    "export": Check("Export", "the trained adversary can be written to files that act as it does"),
    "blinding": Check("Blinding", "it can be scored while the opponent is hidden from it"),
    "one game": Check("One game", "it trains on a single game"),
    "many games": Check("Many games", "it trains on any number of games"),
    "companions": Check("Companions", "it trains beside observers, and where another method requires it"),
}

GAME_CHECKS = {
    "spec": Check("Game spec", "what a GameSpec names exists, loads and is what it must be"),
    "layout": Check("Layout", "sizes, blocks, opponent channels and causes fit each other"),
    "arrays": Check("Arrays", "observations, rewards and flags have the documented shapes, types and values"),
    "endings": Check("Endings", "done, winner, cause and lengths tell one story"),
    "seeds": Check("Game seeds", "a seed gives the same games bit for bit at any number of threads"),
    "save": Check("Saved games", "state_dict is plain data, and a game that loads it goes on bit for bit"),
    "reset": Check("Reset", "reset(mask) starts new games in those rows and leaves the others alone"),
    "inactive": Check("Inactive games", "games that are not active stand still and change no other"),
    "ended": Check("Ended games", "ended games stay ended until reset"),
    "bounds": Check("Action bounds", "actions out of bounds count as those at the bounds"),
    "beside": Check("Games beside", "how a game goes does not depend on what is played beside it"),
    "buffers": Check("Old observations", "observations keep their content until the step after the next one"),
    "first": Check("First step", "a step before any reset is an error"),
    "one": Check("A game alone", "it can be played with num_envs=1"),
    "views": Check("Views", "it passes PettingZoo's and Gymnasium's own checkers"),
}

VICTIM_CHECKS = {
    "load": Check("Loading", "its name loads it, in the sizes of the seat, and its info names it again"),
    "hash": Check("Hash", "the same name gives the same SHA-256 each time"),
    "acts": Check("Acting", "it does what apil_core.Policy asks for"),
    "same": Check("Same actions", "loaded twice it does the same, and its saved state continues it"),
    "play": Check("Playing", "it plays, and the same seed gives the same score"),
}

_CORE_HOOKS = tuple(
    name for place in (RunHooks, ProcessHooks) for name in vars(place) if not name.startswith("_")
)


def hook_address(hook: str) -> str:
    """Page and anchor of a hook's documentation."""
    return f"hooks.md#{hook}" if hook in _CORE_HOOKS else "hooks.md#hooks-of-your-own"


class ContractError(AssertionError):
    """A plugin failed a check. The message says which, what happened, and where it is documented.

    Attributes:
        check: that failed.
        address: page and section below ``docs/``.
    """

    def __init__(self, who: str, check: Check, happened: str, hook: str | None = None):
        self.check = check
        self.address = check.address if hook is None else hook_address(hook)
        super().__init__(f"{who}: {happened}\n  contract: {check.text}\n  docs: {self.address}")

    @property
    def promise(self) -> Check:
        """:attr:`check` by its older name."""
        return self.check


def hook_in(message: str) -> str | None:
    """The first core hook that an error's message names, or ``None``."""
    found = re.search(rf"\b({'|'.join(_CORE_HOOKS)})\b", message)
    return found[1] if found else None


@dataclass
class Subject:
    """A plugin under test.

    Attributes:
        kind: ``"method"``, ``"game"`` or ``"victim"``.
        checks: all of its kind, by key.
        name: of the plugin, for messages.
        skipped: checks that could not be made, with reasons.
    """

    kind: ClassVar[str]
    checks: ClassVar[dict[str, Check]]

    name: str
    skipped: list[str] = field(default_factory=list, kw_only=True)
    _check: str = field(default="", kw_only=True)

    @contextmanager
    def check(self, key: str, *besides: type[ApilError]) -> Iterator[None]:
        """Make the check of that key: any exception within is its failure, ``besides`` those.

        Raises:
            ContractError: anything was raised; a hook's mistake has the address of its documentation.
        """
        outer, self._check = self._check, key
        try:
            yield
        except ContractError:
            raise
        except ApilError as error:
            if isinstance(error, besides):
                raise
            hook = hook_in(str(error)) if isinstance(error, PluginError) else None
            raise self.failed(str(error), hook) from error
        except failures() as error:
            raise self.failed(reason_of(error)) from error
        finally:
            self._check = outer

    def need(self, holds: object, happened: str, hook: str | None = None) -> None:
        """Fail the present check unless ``holds``.

        Raises:
            ContractError: it does not.
        """
        if not holds:
            raise self.failed(happened, hook)

    def failed(self, happened: str, hook: str | None = None) -> ContractError:
        """Make the error of the present check."""
        return ContractError(f"{self.kind} {self.name!r}", self.checks[self._check], happened, hook)

    def checked(self) -> list[str]:
        """Titles of the checks that were made."""
        left_out = {text.split(":")[0].capitalize() for text in self.skipped}
        return [check.title for check in self.checks.values() if check.title not in left_out]


def checking(key: str) -> Callable[[Checks], Checks]:
    """Make a function of a subject, its first argument, the check of that key."""

    def decorate(function: Checks) -> Checks:
        @wraps(function)
        def check(subject: Subject, *given: Any, **named: Any) -> Any:
            with subject.check(key):
                return function(subject, *given, **named)

        return cast(Checks, check)

    return decorate

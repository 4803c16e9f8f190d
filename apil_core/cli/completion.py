"""``apil completion``."""

from __future__ import annotations

from typing import Annotated, Literal

from cyclopts import Parameter

Shell = Literal["bash", "zsh", "fish"]


def completion(shell: Annotated[Shell, Parameter(name="SHELL", help="Whose script to print.")], /) -> None:
    """Print a script that completes verbs, flags and their values; docs/installation.md says where it goes.

    It is made from the verbs as they are now: make it again after an upgrade.
    """
    from apil_core.cli.app import make_app

    print(make_app().generate_completion(shell=shell))

"""``apil play``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Group

from apil_core.cli.flags import ADVERSARY, Flags, Json, PlayFlags, Quiet, flags_of
from apil_core.cli.output import console, emit, print_facts, table
from apil_core.cli.progress import make_progress
from apil_core.evaluation.options import PairingOptions, RenderOptions

if TYPE_CHECKING:
    from apil_core.evaluation.video.recording import PlayResult

_WHERE = Group("Where to (a window, unless a file is named)", sort_key=2)


@flags_of(
    RenderOptions,
    {
        None: ("episodes", "until"),
        _WHERE: ("video", "snapshots", "contact_sheet", "width", "height", "speed", "fps"),
    },
)
class RenderFlags(Flags):
    """Flags of the games to show, and of the video, contact sheet or window."""


def play(
    adversary: Annotated[str, ADVERSARY],
    /,
    *,
    flags: PlayFlags | None = None,
    rendering: RenderFlags | None = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Watch two policies play: in a window, a video or a contact sheet.

    The victim is blue and the adversary red, whichever seats they have. A game depends on the seed and its
    number only, however it is shown.
    """
    from apil_core.evaluation.pairing import load_pairing
    from apil_core.evaluation.video.recording import check_files, show

    options = (flags or PlayFlags()).options(PairingOptions)
    rendered = RenderOptions(seed=options.seed, **(rendering or RenderFlags()).given())
    check_files(rendered)
    with (
        load_pairing(adversary, options, threads=1) as pairing,
        make_progress(quiet=quiet) as progress,
    ):
        result = show(pairing, rendered, progress)
    emit(result, as_json, lambda: _print_games(result))


def _print_games(result: PlayResult) -> None:
    winners = {"win": "adversary", "tie": "tie", "loss": "victim"}
    for role in ("adversary", "victim"):
        actions = {"sample": "sampled", "mode": "mode"}[getattr(result, f"{role}_actions")]
        seat, policy = getattr(result, f"{role}_side"), getattr(result, role)
        print_facts(**{role: f"{seat}, {policy.name}, actions {actions}"})
    print_facts(game=", ".join(f"{key} {value}" for key, value in result.options_played.items()) or None)
    rows = [
        (
            *(str(game.number), winners[game.outcome], game.cause, str(game.steps), f"{game.seconds:.2f} s"),
            *(f"{game.adversary_return:.1f}", f"{game.victim_return:.1f}"),
        )
        for game in result.games
    ]
    returns = ("adversary's return>", "victim's return>")
    console().print(table("game>", "winner", "ending", "steps>", "time>", *returns, rows=rows))
    print_facts(video=result.video, snapshots=result.snapshots)

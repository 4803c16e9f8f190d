"""``apil play``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from apil_core.cli.flags import ADVERSARY, Json, PlayFlags, Quiet
from apil_core.cli.output import console, print_json, table
from apil_core.cli.progress import make_progress
from apil_core.evaluation.options import PairingOptions

if TYPE_CHECKING:
    from apil_core.evaluation.video.recording import PlayResult, RenderOptions

_WHERE = Group("Where to (a window, unless a file is named)", sort_key=2)


@Parameter(name="*")
@dataclass
class Screen:
    """Flags of the video, contact sheet or window."""

    video: Annotated[Path | None, Parameter(group=_WHERE, help="Write a video, FILE.mp4.")] = None
    snapshots: Annotated[
        int | None, Parameter(group=_WHERE, help="Write a contact sheet: so many pictures of each game.")
    ] = None
    out: Annotated[
        Path | None, Parameter(group=_WHERE, help="File of the contact sheet [default: snapshots.png].")
    ] = None
    width: Annotated[
        int | None, Parameter(group=_WHERE, help="Pixels of a frame [default: 960], of a snapshot [480].")
    ] = None
    height: Annotated[
        int | None, Parameter(group=_WHERE, help="Pixels of a frame [default: 540], of a snapshot [320].")
    ] = None
    speed: Annotated[float, Parameter(group=_WHERE, help="1: real time, 0.25: slow motion.")] = 1.0
    fps: Annotated[float, Parameter(group=_WHERE, help="About so many frames a second.")] = 30.0

    def options(self, **which: Any) -> RenderOptions:
        """Return the options of the games; ``which``: the other fields of :class:`.recording.RenderOptions`.

        Raises:
            ConfigError: a file without pictures to write to it.
        """
        from apil_core.common.errors import ConfigError
        from apil_core.evaluation.video.recording import RenderOptions

        if self.out is not None and self.snapshots is None:
            raise ConfigError("--out names the file of --snapshots N, which is missing")
        names = ("video", "snapshots", "width", "height", "speed", "fps")
        where = {name: getattr(self, name) for name in names}
        return RenderOptions(**where, contact_sheet=self.out or Path("snapshots.png"), **which)


def play(
    adversary: Annotated[str, ADVERSARY],
    /,
    *,
    flags: PlayFlags | None = None,
    episodes: Annotated[
        int | None, Parameter(help="Games to show, or with --until to try at most [default: 1 or 100].")
    ] = None,
    until: Annotated[
        Literal["win", "tie", "loss"] | None,
        Parameter(help="Show only the first game that ends like this for the adversary."),
    ] = None,
    screen: Screen | None = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Watch two policies play: in a window, a video or a contact sheet.

    The victim is blue and the adversary red, whichever seats they have. A game depends on the seed and its
    number only, however it is shown.
    """
    from apil_core.evaluation.pairing import load_pairing
    from apil_core.evaluation.video.recording import show

    options = (flags or PlayFlags()).options(PairingOptions)
    rendering = (screen or Screen()).options(seed=options.seed, episodes=episodes, until=until)
    rendering.check()
    with (
        load_pairing(adversary, options, threads=1) as pairing,
        make_progress(quiet=quiet) as progress,
    ):
        result = show(pairing, rendering, progress)
    if as_json:
        print_json(result)
    else:
        _print_games(result)


def _print_games(result: PlayResult) -> None:
    out = console()
    for role in ("adversary", "victim"):
        seat, policy = getattr(result, f"{role}_side"), getattr(result, role)
        actions = {"sample": "sampled", "mode": "mode"}[getattr(result, f"{role}_actions")]
        out.print(f"{role:<10} {seat}, {policy.name}, actions {actions}", markup=False)
    if result.options_played:
        played = ", ".join(f"{key} {value}" for key, value in result.options_played.items())
        out.print(f"game       {played}", markup=False)
    rows = table("game>", "winner", "ending", "steps>", "time>", "adversary's return>", "victim's return>")
    winners = {"win": "adversary", "tie": "tie", "loss": "victim"}
    for game in result.games:
        returns = (f"{game.adversary_return:.1f}", f"{game.victim_return:.1f}")
        time = f"{game.seconds:.2f} s"
        rows.add_row(str(game.number), winners[game.outcome], game.cause, str(game.steps), time, *returns)
    out.print(rows)
    for name in ("video", "snapshots"):
        if (path := getattr(result, name)) is not None:
            out.print(f"{name:<10} {path}", markup=False)

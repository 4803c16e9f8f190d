"""``apil play``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from apil_core.cli.flags import Json, Plugins
from apil_core.cli.output import console, print_json, table

if TYPE_CHECKING:
    from apil_core.show import PlayResult

ActionMode = Literal["sample", "mode"]
_WHERE = Group("Where to (a window, unless a file is named)", sort_key=2)


def play(
    adversary: Annotated[
        str,
        Parameter(name="ADVERSARY", help="Run directory, a policy such as zoo:GAME/SIDE/v1, random or zero."),
    ],
    /,
    *,
    env: Annotated[
        str | None, Parameter(alias="-e", help="Game; needed unless ADVERSARY is a run [default: the run's].")
    ] = None,
    victim: Annotated[
        str | None,
        Parameter(help="Whom it plays, named likewise [default: the run's victim, else the game's]."),
    ] = None,
    seed: Annotated[int, Parameter(help="Seed of the games and of all draws.")] = 0,
    episodes: Annotated[
        int | None, Parameter(help="Games to show, or with --until to try at most [default: 1 or 100].")
    ] = None,
    until: Annotated[
        Literal["win", "tie", "loss"] | None,
        Parameter(help="Show only the first game that ends like this for the adversary."),
    ] = None,
    adversary_actions: Annotated[
        ActionMode | None, Parameter(help="Draw actions, or take the mode [default: as configured].")
    ] = None,
    victim_actions: Annotated[
        ActionMode | None, Parameter(help="Draw actions, or take the mode [default: as configured].")
    ] = None,
    set: Annotated[
        list[str] | None,
        Parameter(show_default=False, metavar="game.KEY=VALUE", help="One option of the game; repeatable."),
    ] = None,
    checkpoint: Annotated[
        Path | None, Parameter(help="Checkpoint of the run to show [default: the newest].")
    ] = None,
    plugin: Plugins | None = None,
    video: Annotated[Path | None, Parameter(group=_WHERE, help="Write a video, FILE.mp4.")] = None,
    snapshots: Annotated[
        int | None, Parameter(group=_WHERE, help="Write a strip of so many pictures, the last at the end.")
    ] = None,
    out: Annotated[
        Path | None, Parameter(group=_WHERE, help="File for the strip [default: snapshots.png].")
    ] = None,
    width: Annotated[
        int | None, Parameter(group=_WHERE, help="Pixels of a frame [default: 960], of a snapshot [480].")
    ] = None,
    height: Annotated[
        int | None, Parameter(group=_WHERE, help="Pixels of a frame [default: 540], of a snapshot [320].")
    ] = None,
    speed: Annotated[float, Parameter(group=_WHERE, help="1: real time, 0.25: slow motion.")] = 1.0,
    fps: Annotated[float, Parameter(group=_WHERE, help="About so many frames a second.")] = 30.0,
    as_json: Json = False,
) -> None:
    """Watch two policies play: in a window, a video or a strip of snapshots.

    The victim is blue and the adversary red, whichever seats they have. A game depends on the seed and its
    number only, whether anybody watches or not.
    """
    from apil_core.extras import need

    need("PIL", "pillow", "pictures")
    from apil_core.errors import ConfigError
    from apil_core.pairing import load_pairing
    from apil_core.show import Programme, show

    if out is not None and snapshots is None:
        raise ConfigError("--out names the file of --snapshots N, which is missing")
    programme = Programme(
        seed=seed,
        episodes=episodes,
        until=until,
        video=video,
        snapshots=snapshots,
        strip=out or Path("snapshots.png"),
        width=width,
        height=height,
        speed=speed,
        fps=fps,
    )
    programme.check()
    pairing = load_pairing(
        adversary,
        num_envs=1,
        env=env,
        victim=victim,
        adversary_actions=adversary_actions,
        victim_actions=victim_actions,
        sets=set or (),
        seed=seed,
        threads=1,
        plugin_files=[str(path) for path in plugin or ()],
        checkpoint_path=checkpoint,
    )
    with pairing:
        result = show(pairing, programme)
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

"""``apil crossplay``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from apil_core.api.config import ActionMode
from apil_core.api.profiles import Profile
from apil_core.cli.flags import PHYSICS_HELP, Json, Plugins, Quiet
from apil_core.cli.output import print_json
from apil_core.cli.progress import make_progress

if TYPE_CHECKING:
    from apil_core.evaluation.crossplay.document import CrossPlay
    from apil_core.evaluation.crossplay.players import SharedOptions
from typing import TYPE_CHECKING

from apil_core.cli.output import console, table
from apil_core.cli.readout import percent, physics

_UP, _LEFT = "≈↑", "≈←"


_WHO = Group("Who plays", sort_key=0)
WHERE = Group("In which game; the same one for all", sort_key=1)

Physics = Annotated[
    Profile | None,
    Parameter(group=WHERE, help=f"Physics profile; {PHYSICS_HELP} [default: the runs', else faithful]."),
]
Actions = Annotated[
    ActionMode | None,
    Parameter(group=WHERE, help="Draw actions, or take the mode [default: as configured]."),
]
GameSets = Annotated[
    list[str] | None,
    Parameter(
        name="--set", group=WHERE, metavar="game.KEY=VALUE", help="One option of the game; repeatable."
    ),
]


def listed(_: Any, tokens: Any) -> list[str]:
    """Words between commas, of one flag or of several."""
    words = [word.strip() for token in tokens for word in token.value.split(",")]
    if not all(words):
        raise ValueError("an empty word between commas")
    return words


def names(text: str, **options: Any) -> Parameter:
    """A flag that takes words between commas."""
    return Parameter(help=text, converter=listed, negative=(), **options)


def crossplay(
    *,
    adversaries: Annotated[
        list[str],
        names(
            "Run directories or policies (zoo:GAME/SIDE/v1, …), random, zero.", group=_WHO, metavar="NAME,…"
        ),
    ],
    victims: Annotated[
        list[str],
        names("Policies or directories, named likewise; auto: the game's.", group=_WHO, metavar="NAME,…"),
    ],
    labels: Annotated[
        list[str] | None,
        names("What rows are called [default: methods, policy names].", group=_WHO, metavar="LABEL,…"),
    ] = None,
    victim_labels: Annotated[
        list[str] | None,
        names("What columns are called [default: original, names].", group=_WHO, metavar="LABEL,…"),
    ] = None,
    env: Annotated[
        str | None, Parameter(alias="-e", group=WHERE, help="Game; needed if no adversary is a run.")
    ] = None,
    physics: Physics = None,
    adversary_actions: Actions = None,
    victim_actions: Actions = None,
    sets: GameSets = None,
    episodes: Annotated[int, Parameter(help="Games of each pairing; 300 give ± 6 points at 50 %.")] = 300,
    seed: Annotated[
        int, Parameter(help="Seed of the games and of all draws, the same for each pairing.")
    ] = 0,
    num_envs: Annotated[
        int | None, Parameter(help="Games in parallel; a seed's games depend on it [default: up to 128].")
    ] = None,
    threads: Annotated[int, Parameter(help="Physics threads; 0: all CPUs. Never changes results.")] = 0,
    out: Annotated[
        Path | None,
        Parameter(help="Keep the scores in this JSON file, and play only pairings that are not yet in it."),
    ] = None,
    picture: Annotated[
        Path | None, Parameter(help="Draw a heat map: .png, .svg or .pdf; replaced if it exists.")
    ] = None,
    plugin: Plugins | None = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Score every adversary against every victim, with Wilson 95 % intervals.

    Everybody is loaded and checked before the first game. With --out, the same command continues where it
    was stopped, also with players added; a file that was made with other settings is refused.
    """
    from apil_core.common.charts import check_picture
    from apil_core.common.files import check_place
    from apil_core.evaluation.crossplay.crossplay import crossplay as play
    from apil_core.evaluation.crossplay.document import comparisons
    from apil_core.runs.labels import labelled

    if picture is not None:
        check_picture(picture)
        check_place(picture)
    options: SharedOptions = {
        "env": env,
        "physics": physics,
        "adversary_actions": adversary_actions,
        "victim_actions": victim_actions,
        "sets": sets or [],
        "plugin_files": [str(path) for path in plugin or ()],
        "threads": threads,
    }
    with make_progress(quiet=quiet) as progress:
        document = play(
            labelled(adversaries, labels, env, side="adversary"),
            labelled(victims, victim_labels, env, side="victim"),
            episodes=episodes,
            seed=seed,
            num_envs=num_envs,
            out=out,
            command=["apil", *sys.argv[1:]],
            progress=progress,
            **options,
        )
    if picture is not None:
        from apil_core.evaluation.crossplay.heat_map import draw_crossplay

        draw_crossplay(document, picture)
    if as_json:
        compared = [each.model_dump(mode="json") for each in comparisons(document)]
        print_json({**document.model_dump(mode="json"), "comparisons": compared})
    else:
        print_crossplay(document, out, picture)


def print_crossplay(document: CrossPlay, out: Path | None = None, picture: Path | None = None) -> None:
    """A row for each adversary and share, a column for each victim; then who they are."""
    from apil_core.evaluation.crossplay.document import SHARES, share_of

    screen, some = console(), document.played[0]
    title = f"{document.env}, {some.episodes:,} games a cell, the adversary's share{physics(some)}"
    screen.print(title, style="bold", markup=False)
    marks = _marks(document)
    shown = table("adversary", "", *(f"{player.label}>" for player in document.victims))
    for i, adversary in enumerate(document.adversaries):
        for share in SHARES:
            cells = []
            for j, victim in enumerate(document.victims):
                score = document.scores[i][j]
                mark = marks.get((share, adversary.label, victim.label), "")
                cells.append("–" if score is None else f"{percent(share_of(score, share))} {mark}".rstrip())
            first = share == SHARES[0]
            shown.add_row(adversary.label if first else "", share.replace("_or_", "+"), *cells)
    screen.print(shown)
    for line in _legend(document):
        screen.print(line, markup=False)
    for side, players in (("adversary", document.adversaries), ("victim", document.victims)):
        for player in players:
            who = f"{player.name} (sha256 {player.sha256[:12]})"
            screen.print(
                f"{side:<10} {player.label}: {who}" if player.label != player.name else f"{side:<10} {who}",
                markup=False,
            )
    modes = f"actions {some.adversary_actions}/{some.victim_actions}"
    screen.print(f"games      seed {some.seed}, {some.num_envs} in parallel, {modes}", markup=False)
    for name, path in (("scores", out), ("picture", picture)):
        if path is not None:
            screen.print(f"{name:<10} {path}", markup=False)


def _marks(document: CrossPlay) -> dict[tuple[str, str, str], str]:
    """What a cell does not differ from by more than noise, by share, adversary and victim."""
    from apil_core.evaluation.crossplay.document import comparisons

    marks: dict[tuple[str, str, str], list[str]] = {}
    for each in comparisons(document):
        if each.difference.within_noise:
            mark = _UP if each.base_victim == each.victim else _LEFT
            marks.setdefault((each.share, each.adversary, each.victim), []).append(mark)
    return {cell: " ".join(found) for cell, found in marks.items()}


def _legend(document: CrossPlay) -> list[str]:
    first, original = document.adversaries[0].label, document.victims[0].label
    lines = []
    if len(document.adversaries) > 1:
        lines.append(f"{_UP} no more than noise from {first} against the same victim (Newcombe 95 %)")
    if len(document.victims) > 1:
        lines.append(f"{_LEFT} no more than noise from the same adversary against {original} (Newcombe 95 %)")
    return lines

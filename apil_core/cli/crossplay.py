"""``apil crossplay``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from apil_core.cli.flags import Json, PairingFlags, Quiet, flags_of
from apil_core.cli.output import console, emit, print_facts, table
from apil_core.cli.progress import make_progress
from apil_core.cli.readout import percent, physics
from apil_core.evaluation.options import PairingOptions

if TYPE_CHECKING:
    from apil_core.evaluation.crossplay.document import CrossPlay

_UP, _LEFT = "≈↑", "≈←"

_WHO = Group("Who plays", sort_key=0)
WHERE = Group("In which game; the same one for all", sort_key=1)


@flags_of(
    PairingOptions,
    {
        WHERE: ("env", "physics", "adversary_actions", "victim_actions", "sets"),
        None: ("seed", "num_envs", "threads", "plugin_files"),
    },
    {
        "env": "Game; needed if no adversary is a run.",
        "sets": "One option of the game (game.KEY); repeatable.",
        "seed": "Seed of the games and of all draws, the same for each pairing. [default: 0]",
    },
)
class CrossPlayFlags(PairingFlags):
    """Flags for the game of all pairings."""


def listed(_: Any, tokens: Any) -> list[str]:
    """Split comma-separated names, in one flag or several."""
    words = [word.strip() for token in tokens for word in token.value.split(",")]
    if not all(words):
        raise ValueError("an empty word between commas")
    return words


def names(text: str, **options: Any) -> Parameter:
    """Type of a flag that takes comma-separated names."""
    return Parameter(help=text, converter=listed, negative=(), **options)


def _players(text: str, metavar: str) -> Parameter:
    return names(text, group=_WHO, metavar=metavar)


def crossplay(
    *,
    adversaries: Annotated[
        list[str],
        _players("Run directories or policies (zoo:GAME/SIDE/v1, …), random, zero.", "NAME,…"),
    ],
    victims: Annotated[
        list[str], _players("Policies or directories, named likewise; auto: the game's.", "NAME,…")
    ],
    labels: Annotated[
        list[str] | None, _players("What rows are called [default: methods, policy names].", "LABEL,…")
    ] = None,
    victim_labels: Annotated[
        list[str] | None, _players("What columns are called [default: original, names].", "LABEL,…")
    ] = None,
    flags: CrossPlayFlags | None = None,
    episodes: Annotated[int, Parameter(help="Games of each pairing; 300 give ± 6 points at 50 %.")] = 300,
    out: Annotated[
        Path | None,
        Parameter(help="Keep the scores in this JSON file, and play only pairings that are not yet in it."),
    ] = None,
    picture: Annotated[Path | None, Parameter(help="Draw a heat map: .png, .svg or .pdf.")] = None,
    force: Annotated[bool, Parameter(show_default=False, help="Replace the picture if it exists.")] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Score every adversary against every victim, with Wilson 95 % intervals.

    All players are loaded and checked before the first game. With --out, the same command continues where it
    was stopped, also with players added; a file that was made with other settings is refused.
    """
    from apil_core.common.charts import check_picture
    from apil_core.common.files import check_free, check_place
    from apil_core.evaluation.crossplay.crossplay import crossplay as play
    from apil_core.evaluation.crossplay.document import comparisons
    from apil_core.runs.labels import labelled

    if picture is not None:
        check_picture(picture)
        check_place(picture)
        check_free(picture, force=force)
    options = (flags or CrossPlayFlags()).options(PairingOptions)
    with make_progress(quiet=quiet) as progress:
        document = play(
            labelled(adversaries, labels, options.env, side="adversary"),
            labelled(victims, victim_labels, options.env, side="victim"),
            options,
            episodes=episodes,
            out=out,
            command=["apil", *sys.argv[1:]],
            progress=progress,
        )
    if picture is not None:
        from apil_core.evaluation.crossplay.heat_map import draw_crossplay

        draw_crossplay(document, picture)
    result = {**document.model_dump(mode="json"), "comparisons": comparisons(document)}
    emit(result, as_json, lambda: print_crossplay(document, out, picture))


def print_crossplay(document: CrossPlay, out: Path | None = None, picture: Path | None = None) -> None:
    """Print a row per adversary and share, a column per victim, then the players' full names."""
    from apil_core.evaluation.crossplay.document import SHARES, share_of

    screen, some = console(), document.played[0]
    title = f"{document.env}, {some.episodes:,} games a cell, the adversary's share{physics(some)}"
    screen.print(title, style="bold")
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
        screen.print(line)
    for side, players in (("adversary", document.adversaries), ("victim", document.victims)):
        for player in players:
            who = f"{player.name} (sha256 {player.sha256[:12]})"
            named = f"{player.label}: {who}" if player.label != player.name else who
            print_facts(**{side: named})
    modes = f"actions {some.adversary_actions}/{some.victim_actions}"
    games = f"seed {some.seed}, {some.num_envs} in parallel, {modes}"
    print_facts(games=games, scores=out, picture=picture)


def _marks(document: CrossPlay) -> dict[tuple[str, str, str], str]:
    """Marks of cells whose difference is within noise, by share, adversary and victim."""
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

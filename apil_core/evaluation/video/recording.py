"""Showing games between two policies in a video, a contact sheet or a window (``apil play``)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from apil_core.api.profiles import FAITHFUL
from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.files import check_place
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.options import RenderOptions
from apil_core.evaluation.pairing import Pairing
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import MatchSetup
from apil_core.evaluation.video.contact_sheet import check_contact_sheet
from apil_core.evaluation.video.mp4 import check_mp4
from apil_core.evaluation.video.overlay import OverlayText
from apil_core.evaluation.video.single_game import Frame, PlayedGame, SingleGames
from apil_core.evaluation.video.viewers import (
    Camera,
    ContactSheet,
    LiveViewer,
    VideoRecorder,
    Viewer,
    WindowClosed,
)

TRIES = 100
"""Default number of games tried for one with the wanted outcome."""

FRAME_SIZE, SNAPSHOT_SIZE = (960, 540), (480, 320)
"""Default width and height of a video's frame and of a snapshot, pixels."""


def check_files(options: RenderOptions) -> None:
    """Check that the files can be written, before anything is played.

    Raises:
        ApilError: one of them cannot.
    """
    if options.video is not None:
        check_mp4(options.video, *options.size(FRAME_SIZE))
        _check_free(options.video)
    if options.snapshots is not None:
        check_contact_sheet(options.sheet, options.snapshots, options.games, options.size(SNAPSHOT_SIZE))
        _check_free(options.sheet)


class PlayResult(MatchSetup):
    """Players and outcomes. ``wins`` etc. are the adversary's."""

    wins: int
    ties: int
    losses: int
    games: list[PlayedGame]
    video: Path | None = None
    snapshots: Path | None = None


def show(pairing: Pairing, options: RenderOptions, progress: Progress | None = None) -> PlayResult:
    """Play and show games according to the options.

    Args:
        pairing: made with ``num_envs=1``.
        options: its files were checked by the caller.
        progress: gets a note of every game shown, and of those played before one had the wanted outcome.

    Raises:
        ApilError: drawing is impossible here, or no game had the wanted outcome.
    """
    progress = progress or Progress()
    text = _text(pairing, options)
    single = SingleGames(pairing, options.seed)
    pairing.game.seed(0)
    pairing.game.reset()  # so that the cameras have a state to draw
    games: list[PlayedGame] = []
    with one_torch_thread(), pairing.attribution():
        viewers = _viewers(pairing, options, text)
        try:
            for number, ahead in _chosen(single, options, progress):
                games.append(_show_game(single, number, ahead, viewers, text))
                progress.note(f"game {number} shown: {games[-1].outcome}, {games[-1].cause}")
            for viewer in viewers:
                viewer.finish()
        except BaseException as reason:
            for viewer in viewers:
                viewer.abandon()
            if not isinstance(reason, WindowClosed):
                raise
    return PlayResult(
        **pairing.setup(options.seed),
        wins=text.score["win"],
        ties=text.score["tie"],
        losses=text.score["loss"],
        games=games,
        video=options.video,
        snapshots=options.sheet if options.snapshots is not None else None,
    )


def _chosen(
    single: SingleGames, options: RenderOptions, progress: Progress
) -> Iterator[tuple[int, PlayedGame | None]]:
    """Numbers of the games to show, each with its outcome where that is known or a contact sheet needs it."""
    if options.until is None:
        for number in range(1, options.games + 1):
            yield number, None if options.snapshots is None else single.play(number)
        return
    tries = options.episodes or TRIES
    found = single.find(
        options.until, tries, lambda game: progress.note(f"game {game.number} of {tries}: {game.outcome}")
    )
    if found is None:
        raise ApilError(
            f"none of {tries} games was a {options.until} of the adversary; "
            "apil play takes --episodes and --seed to try others"
        )
    yield found.number, found


def _show_game(
    single: SingleGames, number: int, ahead: PlayedGame | None, viewers: list[Viewer], text: OverlayText
) -> PlayedGame:
    for viewer in viewers:
        viewer.begin(ahead)

    def watch(frame: Frame) -> None:
        if frame.ended is not None:
            text.score[frame.ended.outcome] += 1
        for viewer in viewers:
            viewer.see(frame)

    played = single.play(number, watch)
    if ahead not in (None, played):
        raise ApilError(
            "the same game went another way when played again: a policy or a hook draws from "
            "something else than the generator it is given"
        )
    return played


def _text(pairing: Pairing, options: RenderOptions) -> OverlayText:
    sides = pairing.game.layout.sides
    victim = f"{sides[1 - pairing.side].name}, {pairing.victim.info.name}"
    adversary = f"{sides[pairing.side].name}, {pairing.adversary.info.name}"
    physics = pairing.game.settings.get("physics", FAITHFUL)
    note = "" if physics == FAITHFUL else f"physics {physics}"
    return OverlayText(victim, adversary, options.games, Counter(), note)


def _viewers(pairing: Pairing, options: RenderOptions, text: OverlayText) -> list[Viewer]:
    game, side = pairing.game, pairing.side
    viewers: list[Viewer] = []
    if options.snapshots is not None:
        camera = Camera(game, side, options.size(SNAPSHOT_SIZE))
        viewers.append(ContactSheet(options.sheet, camera, text, options.snapshots))
    if options.video is not None:
        camera, pace = Camera(game, side, options.size(FRAME_SIZE)), (options.speed, options.fps)
        viewers.append(VideoRecorder(options.video, camera, text, game.seconds_per_step, *pace))
    if not viewers:
        try:
            viewers.append(LiveViewer(game, side, text, options.speed))
        except ApilError as error:
            raise ApilError(f"{error}; use --video FILE.mp4 or --snapshots N") from error
    return viewers


def _check_free(path: Path) -> None:
    if path.exists():
        raise ConfigError(f"{path} exists already; nothing is overwritten")
    check_place(path)

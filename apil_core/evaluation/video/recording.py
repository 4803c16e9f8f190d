"""Showing games between two policies: which ones, to whom, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from apil_core.api.profiles import FAITHFUL
from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.files import why_unwritable
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.pairing import Pairing, circumstances
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import Circumstances
from apil_core.evaluation.video.contact_sheet import check_strip
from apil_core.evaluation.video.mp4 import check_film
from apil_core.evaluation.video.overlay import Cast, Score
from apil_core.evaluation.video.single_game import Moment, Outcome, PlayedGame, Spectacle
from apil_core.evaluation.video.viewers import (
    Audience,
    Camera,
    FilmAudience,
    StripAudience,
    WindowAudience,
    WindowClosed,
)

TRIES = 100
"""Games looked at for one that ends as wished, unless told otherwise."""

FILM_SIZE, SNAPSHOT_SIZE = (960, 540), (480, 320)
"""Pixels of a frame and of a snapshot, unless told otherwise."""


LARGEST = 4096
"""Pixels a picture may be wide or high."""

SPEEDS, RATES = (0.001, 1000.0), (1.0, 1000.0)
"""Least and most of ``speed`` and ``fps``: a film's frame rate can be written down."""


@dataclass(frozen=True)
class Programme:
    """What is to be shown, and where.

    Attributes:
        seed: of everything random.
        episodes: games to show; with ``until``: to try. ``None``: 1, or :data:`TRIES`.
        until: show only the first game that ends like this for the adversary.
        video: file to write, or ``None``.
        snapshots: pictures of each game in the strip, or ``None``.
        strip: file for the strip.
        width, height: of a frame and of a snapshot, pixels.
        speed: 1 is real time.
        fps: what the video's frame rate should be near to.
    """

    seed: int = 0
    episodes: int | None = None
    until: Outcome | None = None
    video: Path | None = None
    snapshots: int | None = None
    strip: Path = Path("snapshots.png")
    width: int | None = None
    height: int | None = None
    speed: float = 1.0
    fps: float = 30.0

    @property
    def games(self) -> int:
        """How many are shown."""
        return 1 if self.until else self.episodes or 1

    def size(self, default: tuple[int, int]) -> tuple[int, int]:
        """Width and height, with the default where nothing was said."""
        return self.width or default[0], self.height or default[1]

    def check(self) -> None:
        """Whether all this can be done, as far as one can tell without playing.

        Raises:
            ApilError: it cannot.
        """
        if self.episodes is not None and self.episodes < 1:
            raise ConfigError(f"--episodes must be at least 1, got {self.episodes}")
        for name, value, bounds in (("--speed", self.speed, SPEEDS), ("--fps", self.fps, RATES)):
            if not bounds[0] <= value <= bounds[1]:
                raise ConfigError(f"{name} takes {bounds[0]:g} to {bounds[1]:g}, got {value:g}")
        for name, pixels in (("--width", self.width), ("--height", self.height)):
            if pixels is not None and not 1 <= pixels <= LARGEST:
                raise ConfigError(f"{name} takes 1 to {LARGEST}, got {pixels}")
        if self.video is not None:
            check_film(self.video, *self.size(FILM_SIZE))
            _check_free(self.video)
        if self.snapshots is not None:
            check_strip(self.strip, self.snapshots, self.games, self.size(SNAPSHOT_SIZE))
            _check_free(self.strip)


class PlayResult(Circumstances):
    """Who played, and how the games went. ``wins`` and the like are the adversary's."""

    wins: int
    ties: int
    losses: int
    games: list[PlayedGame]
    video: Path | None = None
    snapshots: Path | None = None


def show(pairing: Pairing, programme: Programme, progress: Progress | None = None) -> PlayResult:
    """Play and show what the programme asks for.

    Args:
        pairing: made with ``num_envs=1``.
        programme: checked by the caller.
        progress: told of every game that was shown, or tried before one ended as wished.

    Raises:
        ApilError: nothing can be drawn here, or no game ended as wished.
    """
    progress = progress or Progress()
    cast = _cast(pairing, programme)
    spectacle = Spectacle(pairing, programme.seed)
    pairing.game.seed(0)
    pairing.game.reset()  # so that there is something to try the cameras on
    games: list[PlayedGame] = []
    with one_torch_thread(), pairing.attribution():
        audiences = _audiences(pairing, programme, cast)
        try:
            for number in _numbers(spectacle, programme, progress):
                games.append(_show_game(spectacle, number, audiences, cast))
                progress.note(f"game {number} shown: {games[-1].outcome}, {games[-1].cause}")
            for audience in audiences:
                audience.finish()
        except BaseException as reason:
            for audience in audiences:
                audience.abandon()
            if not isinstance(reason, WindowClosed):
                raise
    return _result(pairing, programme, cast.score, games)


def _show_game(spectacle: Spectacle, number: int, audiences: list[Audience], cast: Cast) -> PlayedGame:
    ahead = spectacle.play(number) if any(audience.knows_ahead for audience in audiences) else None
    for audience in audiences:
        audience.begin(ahead)

    def watch(moment: Moment) -> None:
        if moment.ended is not None:
            cast.score.add(moment.ended.outcome)
        for audience in audiences:
            audience.see(moment)

    played = spectacle.play(number, watch)
    if ahead not in (None, played):
        raise ApilError(
            "the same game went another way when played again: a policy or a hook draws from "
            "something else than the generator it is given"
        )
    return played


def _numbers(spectacle: Spectacle, programme: Programme, progress: Progress) -> list[int]:
    if programme.until is None:
        return list(range(1, programme.games + 1))
    tries = programme.episodes or TRIES
    found = spectacle.find(
        programme.until, tries, lambda game: progress.note(f"game {game.number} of {tries}: {game.outcome}")
    )
    if found is None:
        raise ApilError(
            f"none of {tries} games was a {programme.until} of the adversary; "
            "apil play takes --episodes and --seed to try others"
        )
    return [found.number]


def _cast(pairing: Pairing, programme: Programme) -> Cast:
    sides = pairing.game.layout.sides
    victim = f"{sides[1 - pairing.side].name}, {pairing.victim.info.name}"
    adversary = f"{sides[pairing.side].name}, {pairing.adversary.info.name}"
    physics = pairing.game.settings.get("physics", FAITHFUL)
    note = "" if physics == FAITHFUL else f"physics {physics}"
    return Cast(victim, adversary, programme.games, Score(), note)


def _audiences(pairing: Pairing, programme: Programme, cast: Cast) -> list[Audience]:
    game, side = pairing.game, pairing.side
    audiences: list[Audience] = []
    if programme.snapshots is not None:
        camera = Camera(game, side, *programme.size(SNAPSHOT_SIZE))
        audiences.append(StripAudience(programme.strip, camera, cast, programme.snapshots))
    if programme.video is not None:
        size = programme.size(FILM_SIZE)
        camera, pace = Camera(game, side, *size), {"speed": programme.speed, "fps": programme.fps}
        audiences.append(FilmAudience(programme.video, camera, size, cast, game.seconds_per_step, **pace))
    if not audiences:
        try:
            audiences.append(WindowAudience(game, side, cast, programme.speed))
        except ApilError as error:
            raise ApilError(f"{error}; use --video FILE.mp4 or --snapshots N") from error
    return audiences


def _result(pairing: Pairing, programme: Programme, score: Score, games: list[PlayedGame]) -> PlayResult:
    return PlayResult(
        **circumstances(pairing, programme.seed),
        wins=score.win,
        ties=score.tie,
        losses=score.loss,
        games=games,
        video=programme.video,
        snapshots=programme.strip if programme.snapshots is not None else None,
    )


def _check_free(path: Path) -> None:
    if path.exists():
        raise ConfigError(f"{path} exists already; nothing is overwritten")
    if not path.parent.is_dir():
        raise ConfigError(f"{path}: there is no directory {path.parent}")
    if (reason := why_unwritable(path.parent)) is not None:
        raise ConfigError(f"{path}: {path.parent} cannot be written to: {reason}")

"""Text in pictures of a game: both players, the score, the time, and the outcome."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from PIL import Image, ImageDraw, ImageFont

from apil_core.common import colours
from apil_core.common.colours import Colour
from apil_core.evaluation.video.single_game import Frame, Outcome, PlayedGame

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont

_DARK = (18, 22, 30, 205)  # background of all text
_WHITE: Colour = (245, 246, 248)
_GREY: Colour = (196, 201, 209)
_VERDICTS = {"win": "adversary wins", "loss": "victim wins", "tie": "tie"}
_GROUNDS = {"win": colours.ADVERSARY, "loss": colours.VICTIM, "tie": colours.NEUTRAL}


@dataclass(frozen=True)
class OverlayText:
    """Both players and the score.

    Attributes:
        victim, adversary: seat and policy, e.g. ``"kicker, zoo:kick-and-defend/kicker/v1"``.
        games: to be shown.
        score: games so far by outcome, the adversary's; grows as games end.
        note: on the games themselves, e.g. that they are not the true ones.
    """

    victim: str
    adversary: str
    games: int
    score: Counter[Outcome]
    note: str = ""

    def clock(self, frame: Frame) -> str:
        """Game, time and step as text."""
        game = f"game {frame.number}, " if self.games > 1 else ""
        return f"{game}{frame.seconds:.2f} s, step {frame.step}"

    def all(self, frame: Frame) -> str:
        """The whole text, for a window."""
        lines = [f"victim (blue): {self.victim}", f"adversary (red): {self.adversary}"]
        score = self.score
        lines.append(f"victim {score['loss']} : {score['win']} adversary, ties {score['tie']}")
        lines += [self.note] if self.note else []
        lines.append(self.clock(frame) if frame.ended is None else verdict(frame.ended))
        return "\n".join(lines)


def verdict(ended: PlayedGame) -> str:
    """Outcome of a game as text."""
    return f"{_VERDICTS[ended.outcome]}: {ended.cause}"


def header(width: int, size: float, text: OverlayText) -> Image.Image:
    """Both names and the score as one line, RGBA, in letters of that height."""
    picture = Image.new("RGBA", (width, round(1.9 * size)), _DARK)
    draw, middle, large = ImageDraw.Draw(picture), picture.height / 2, _font(1.15 * size)
    score = f"{text.score['loss']} : {text.score['win']}"
    score += f", ties {text.score['tie']}" if text.score["tie"] else ""
    score += f", {text.note}" if text.note else ""
    draw.text((width / 2, middle), score, _WHITE, large, anchor="mm")
    room = (width - draw.textlength(score, large)) / 2 - 2.5 * size
    names = (("victim", text.victim, colours.VICTIM), ("adversary", text.adversary, colours.ADVERSARY))
    for i, (role, name, colour) in enumerate(names):
        edge, x, anchor = ((0.0, size, "lm"), (width - size / 2, width - size, "rm"))[i]
        draw.rectangle((edge, 0, edge + size / 2, picture.height), fill=colour)
        words, font = _fitting(f"{role}: {name}", room, size)
        draw.text((x, middle), words, colours.light(colour), font, anchor=anchor)
    return picture


def scoreboard(picture: Image.Image, text: OverlayText) -> None:
    """Draw both names and the score across the top."""
    line = header(picture.width, min(letter_size(picture), picture.width / 50), text)
    picture.paste(line, (0, 0), line)


def clock(picture: Image.Image, text: str) -> None:
    """Draw the time into the lower left corner."""
    _label(picture, text, (0.0, 1.0), _DARK, _GREY, letter_size(picture))


def banner(picture: Image.Image, ended: PlayedGame) -> None:
    """Draw the outcome across the upper middle, where the sky is, in the winner's colour."""
    ground = (*_GROUNDS[ended.outcome], 235)
    _label(picture, verdict(ended), (0.5, 0.1), ground, _WHITE, 1.5 * letter_size(picture))


def letter_size(picture: Image.Image) -> float:
    """Text height for a picture, pixels."""
    return max(8.0, picture.height / 26)


def _label(
    picture: Image.Image,
    text: str,
    place: tuple[float, float],
    ground: tuple[int, int, int, int],
    colour: Colour,
    size: float,
) -> None:
    """Draw text in a box at a relative position, (0, 0) upper left to (1, 1) lower right."""
    text, font = _fitting(text, picture.width - size, size)
    width, height = font.getlength(text) + size, 1.7 * size
    left, top = place[0] * (picture.width - width), place[1] * (picture.height - height)
    ImageDraw.Draw(picture, "RGBA").rectangle((left, top, left + width, top + height), fill=ground)
    middle = (left + width / 2, top + height / 2)
    ImageDraw.Draw(picture).text(middle, text, colour, font, anchor="mm")


def _fitting(text: str, room: float, size: float) -> tuple[str, Font]:
    """Render the text at most that high; smaller or truncated where space is short."""
    smallest = 0.7 * size
    while size > smallest and _font(size).getlength(text) > room:
        size -= 0.5
    font = _font(size)
    while text.rstrip(".") and font.getlength(text) > room:
        text = text.rstrip(".")[:-1] + "..."
    return text, font


def _font(size: float) -> Font:
    return ImageFont.load_default(max(size, 1.0))  # the least there is

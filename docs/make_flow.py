"""Draws the data flow of a run, ``docs/images/data-flow-light.svg`` and ``-dark.svg``.

    python docs/make_flow.py

One drawing in two sets of colours. Nothing in it is measured, so it is text: no library draws it.
"""

from __future__ import annotations

from html import escape
from pathlib import Path

HERE = Path(__file__).parent
WIDTH, HEIGHT = 960, 640

INK = {"light": "#1f2328", "dark": "#e6edf3"}
PALE = {"light": "#59636e", "dark": "#9198a1"}
ROOM = {"light": ("#f6f8fa", "#d1d9e0"), "dark": ("#14181f", "#3d444d")}
PART = {"light": ("#ffffff", "#818b98"), "dark": ("#262c36", "#9198a1")}
HOOK = {"light": ("#fff3d1", "#9a6700"), "dark": ("#3a2d0f", "#d29922")}
VICTIM = {"light": ("#ddf4ff", "#0969da"), "dark": ("#10294a", "#58a6ff")}
ADVERSARY = {"light": ("#ffebe9", "#cf222e"), "dark": ("#47161a", "#ff7b72")}
"""(fill, stroke) of each kind of box."""

Colours = dict[str, tuple[str, str]]


class Drawing:
    """SVG elements in one set of colours."""

    def __init__(self, scheme: str):
        self.scheme = scheme
        self.parts: list[str] = []

    def box(
        self, x: int, y: int, width: int, height: int, colours: Colours, *lines: str, round_: int = 6
    ) -> None:
        """A box with centred lines, the first one bold unless it is a hook's name."""
        fill, stroke = colours[self.scheme]
        self.parts.append(
            f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="{round_}" fill="{fill}" '
            f'stroke="{stroke}" stroke-width="1.5"/>'
        )
        middle = y + height / 2 - (len(lines) - 1) * 9
        for i, line in enumerate(lines):
            kind = "hook" if colours is HOOK else "head" if i == 0 else "small"
            self.text(x + width / 2, middle + 18 * i + 5, line, kind)

    def hook(self, x: int, y: int, name: str, width: int = 170) -> None:
        """A place where plugins step in."""
        self.box(x, y, width, 36, HOOK, name, round_=18)

    def room(self, y: int, height: int, title: str, note: str) -> None:
        """A stage of the run across the whole width."""
        fill, stroke = ROOM[self.scheme]
        self.parts.append(
            f'<rect x="12" y="{y}" width="{WIDTH - 24}" height="{height}" rx="10" fill="{fill}" '
            f'stroke="{stroke}"/>'
        )
        self.text(28, y + 24, title, "room", note)

    def text(self, x: float, y: float, text: str, kind: str, note: str = "") -> None:
        """A line of text; ``note`` follows in pale letters."""
        more = f'<tspan class="note" dx="10">{escape(note)}</tspan>' if note else ""
        self.parts.append(f'<text x="{x:g}" y="{y:g}" class="{kind}">{escape(text)}{more}</text>')

    def arrow(self, *points: tuple[int, int], label: str = "", at: tuple[int, int] = (0, 0)) -> None:
        """A line through the points with its head at the last one."""
        path = " ".join(f"{x},{y}" for x, y in points)
        self.parts.append(f'<polyline points="{path}" class="line" marker-end="url(#head)"/>')
        if label:
            self.text(*at, label, "label")

    def svg(self) -> str:
        """The file's text."""
        ink, pale = INK[self.scheme], PALE[self.scheme]
        style = (
            "text{font-family:system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;"
            "font-size:14px;"
            f"fill:{ink};text-anchor:middle}}"
            ".head{font-weight:600}.small{font-size:12.5px}.room{text-anchor:start;font-weight:600;font-size:15px}"
            f".note{{font-weight:400;font-size:13px;fill:{pale}}}.label{{font-size:12.5px;fill:{pale}}}"
            f".hook{{font-family:ui-monospace,'DejaVu Sans Mono',monospace;font-size:13px;fill:{ink}}}"
            f".line{{fill:none;stroke:{pale};stroke-width:1.6;stroke-linejoin:round}}"
        )
        head = (
            '<marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
            'orient="auto">'
            f'<path d="M0 0 8 4 0 8z" fill="{pale}"/></marker>'
        )
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">\n'
            "<title>Data flow of a run: games, victim, adversary, hooks, learner</title>\n"
            f"<style>{style}</style>\n<defs>{head}</defs>\n" + "\n".join(self.parts) + "\n</svg>\n"
        )


def draw(scheme: str) -> str:
    """The whole picture."""
    d = Drawing(scheme)
    _collect(d)
    _learn(d)
    _keep(d)
    return d.svg()


def _collect(d: Drawing) -> None:
    d.room(12, 372, "Collect", "T steps, all n games at once")
    d.box(44, 146, 150, 72, PART, "games", "physics and rules")
    d.hook(292, 164, "filter_observation")
    d.box(500, 62, 170, 56, VICTIM, "victim ν", "frozen")
    d.hook(500, 164, "extend_observation")
    d.box(720, 152, 160, 60, ADVERSARY, "adversary α", "trained")
    d.arrow((194, 182), (290, 182), label="observations", at=(241, 174))
    d.arrow((377, 164), (377, 90), (498, 90))
    d.arrow((462, 182), (498, 182))
    d.arrow((585, 118), (585, 162), label="its action", at=(622, 144))
    d.arrow((670, 182), (718, 182))
    d.arrow((670, 90), (916, 90), (916, 258), (120, 258), (120, 220), label="actions of both", at=(520, 250))
    d.parts.append('<polyline points="880,182 916,182" class="line"/>')
    d.arrow((72, 218), (72, 318), label="rewards", at=(104, 300))
    d.hook(44, 320, "shape_reward")
    d.arrow((214, 338), (298, 338))
    d.box(300, 312, 190, 52, PART, "rollout", "(T, n, …)")


def _learn(d: Drawing) -> None:
    d.room(400, 120, "Learn", "once per rollout")
    d.arrow((395, 364), (395, 392), (21, 392), (21, 452), (29, 452))
    d.hook(30, 434, "relabel_reward", 150)
    d.hook(30, 478, "finish_rollout", 150)
    d.arrow((105, 470), (105, 477))
    d.arrow((180, 496), (193, 496), (193, 470), (204, 470))
    d.box(206, 440, 140, 60, PART, "advantages", "a critic per stream")
    d.hook(372, 452, "combine_advantages", 178)
    d.hook(576, 452, "update_auxiliary", 160)
    d.box(762, 440, 150, 60, PART, "PPO", "actor and critics")
    for start, end in ((346, 370), (550, 574), (736, 760)):
        d.arrow((start, 470), (end, 470))
    d.arrow((820, 440), (820, 214), label="new weights", at=(864, 340))


def _keep(d: Drawing) -> None:
    d.room(536, 92, "Keep", "log, checkpoint, and in the end a score against the victim")
    d.hook(60, 576, "run_started", 180)
    d.hook(276, 576, "iteration_finished", 190)
    d.hook(502, 576, "evaluation_finished", 190)
    d.hook(728, 576, "run_finished", 180)
    d.arrow((837, 500), (837, 534))


def main() -> None:
    """Write both files."""
    for scheme in ("light", "dark"):
        (HERE / "images" / f"data-flow-{scheme}.svg").write_text(draw(scheme), "utf-8")


if __name__ == "__main__":
    main()

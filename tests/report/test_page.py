"""The report's page as a file: whole, self-contained, and safe from what plugins are called."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import pytest

from apil_core.studies.report.models import Evidence
from apil_core.studies.report.page import render, write_page
from apil_core.studies.report.page_summary import bests
from report import page_sample
from report.page_sample import NASTY


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return page_sample.evidence()


@pytest.fixture(scope="module")
def html(evidence: Evidence) -> str:
    return render(evidence)


class Reader(HTMLParser):
    """Elements with their attributes, and the text of scripts."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.text: list[str] = []
        self._script = False
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._script = tag == "script"
        if self._script:
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._script = False

    def handle_data(self, data):
        if self._script:
            self.scripts[-1] += data
        else:
            self.text.append(data)


@pytest.fixture(scope="module")
def read(html: str) -> Reader:
    return Reader(html)


def test_nothing_is_loaded_from_elsewhere(read: Reader):
    for tag, attributes in read.elements:
        for name in ("src", "href", "action", "data", "srcset", "poster"):
            assert (attributes.get(name) or "#").startswith(("#", "data:")), (tag, attributes)


def test_only_our_two_scripts_may_run(read: Reader):
    policy = next(
        a["content"] for tag, a in read.elements if a.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    figures, plotly, ours = read.scripts
    hashes = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in (plotly, ours)]
    assert rules["script-src"] == " ".join(f"'sha256-{digest}'" for digest in hashes)
    assert rules["default-src"] == "'none'"
    json.loads(figures)


def test_no_handler_stands_in_the_markup(read: Reader):
    assert not [a for _, a in read.elements if any(name.startswith("on") for name in a)]


def test_names_of_plugins_are_text(html: str, read: Reader):
    """It is in a heading, in tables, in alternative texts and in figures; never as an element."""
    assert not [tag for tag, _ in read.elements if tag == "b" and "my" in tag]
    assert "<script>document.title" not in html
    assert len(read.scripts) == 3
    shown = " ".join(read.text)
    assert NASTY in shown
    assert any(NASTY in (a.get("aria-label") or "") for _, a in read.elements)
    names = {t.get("name") for spec in json.loads(read.scripts[0]).values() for t in spec["data"]}
    assert escape(NASTY, quote=False) in names


def test_ids_are_unique_and_links_lead_somewhere(read: Reader):
    ids = [a["id"] for _, a in read.elements if a.get("id")]
    assert len(ids) == len(set(ids))
    links = [a["href"] for tag, a in read.elements if tag == "a" and a.get("href")]
    assert len(links) > 15
    assert {link[1:] for link in links if link} <= set(ids)
    labels = [a[name] for _, a in read.elements for name in ("aria-labelledby", "data-of") if a.get(name)]
    assert set(labels) <= set(ids)


def test_pictures_and_figures_have_words(read: Reader):
    assert all(a.get("alt") for tag, a in read.elements if tag == "img")
    plots = [a for _, a in read.elements if a.get("class") == "plot"]
    assert plots
    assert all(a.get("role") == "img" and a.get("aria-label") for a in plots)


def test_tables_have_the_measured_and_the_published_number(evidence: Evidence, read: Reader):
    figure = evidence.tables[0].rows[0][1].win
    text = re.sub(r"\s+", " ", " ".join(read.text))
    assert figure.measured is not None
    assert figure.difference is not None
    value, low, high = (
        f"{100 * end:.1f}" for end in (figure.measured.value, figure.measured.low, figure.measured.high)
    )
    shown = f"{value} {low} – {high}"
    assert shown in text
    sign = "▲" if figure.difference.value > 0 else "▼"
    points = f"{100 * figure.difference.value:+.1f}".replace("-", "−")
    assert f"{shown} paper 48 {sign} {points}" in text
    assert "≈ noise" in text
    assert "not measured paper 65" in text


def test_marks_are_said_once_per_column_and_others_in_their_field(html: str):
    first = html[html.index('id="table-t1-s1"') : html.index("</table>", html.index('id="table-t1-s1"'))]
    assert first.count("1 M of 35 M = 2.9 %") == 5  # five methods, no baseline, none in a field
    second = html[html.index('id="table-t2-s1"') : html.index("</table>", html.index('id="table-t2-s1"'))]
    assert second.count(">stale<") == 1


def test_short_budgets_are_said_before_any_number(html: str):
    banner = html[html.index('class="banner"') : html.index("</aside>")]
    assert html.index('class="banner"') < html.index('id="overview"')
    for words in ("2.9 % of the published budget", "One seed", "fast physics"):
        assert words in banner
    assert "are ties" not in banner  # concerns one field, not everything


def test_a_setting_without_weakness_has_no_banner(evidence: Evidence):
    strong = evidence.model_copy(
        update={
            "warnings": [],
            "settings": [s.model_copy(update={"notes": []}) for s in evidence.settings],
        }
    )
    assert 'class="banner"' not in render(strong)


def test_missing_parts_say_so_in_one_line(evidence: Evidence):
    lists = [
        name for name, value in evidence if isinstance(value, list) and name not in ("games", "settings")
    ]
    empty = evidence.model_copy(update={name: [] for name in lists})
    html = render(empty)
    for line in (
        "No cell has a score yet.",
        "No cross-play was run.",
        "No victim was retrained.",
        "No activations were recorded.",
        "Nothing was varied.",
    ):
        assert line in html
    assert "Not in this report" in html
    assert 'class="plot"' not in html


def test_file_is_written_whole_and_again(evidence: Evidence, tmp_path: Path):
    path = tmp_path / "index.html"
    path.write_text("old")
    write_page(evidence, path)
    first = path.read_bytes()
    assert first.endswith(b"</html>")
    write_page(evidence, path)
    assert path.read_bytes() == first
    assert [p.name for p in tmp_path.iterdir()] == ["index.html"]


def test_summary_does_not_crown_a_winner_within_noise(evidence: Evidence):
    row = evidence.tables[0].rows[0]
    best = max(row[1:], key=lambda cell: cell.win.measured.value if cell.win.measured else 0.0)
    rival = next(cell for cell in row[1:] if cell is not best)
    even = rival.model_copy(update={"win": best.win})
    table = evidence.tables[0].model_copy(update={"rows": [[row[0], best, even]]})
    clear, level = (
        bests(evidence.model_copy(update={"tables": [t]}))[0] for t in (evidence.tables[0], table)
    )
    assert f"{best.column} won most often" in level
    assert f"within noise of {rival.column}" in level
    assert "within noise" not in clear

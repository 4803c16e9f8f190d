"""The report's page as a file: whole, self-contained, and safe from what plugins are called."""

from __future__ import annotations

import base64
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from markupsafe import escape

from apil_core.studies.report.models import ReportData
from apil_core.studies.report.page import render, write_page
from apil_core.studies.report.page_summary import bests
from apil_core.studies.report.table_models import Figure
from report import page_sample
from report.page_sample import NASTY, WITHOUT_FIGURES

SVG = {"svg", "g", "path", "defs", "use", "text", "clipPath", "rect", "pattern"}
"""Elements that figures are made of."""


@pytest.fixture(scope="module")
def data() -> ReportData:
    return page_sample.report_data()


@pytest.fixture(scope="module")
def html(data: ReportData) -> str:
    return render(data)


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


def test_only_our_script_may_run(read: Reader):
    policy = next(
        a["content"] for tag, a in read.elements if a.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    (script,) = read.scripts
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert rules["script-src"] == f"'sha256-{digest}'"
    assert rules["default-src"] == "'none'"


def test_no_handler_stands_in_the_markup(read: Reader):
    assert not [a for _, a in read.elements if any(name.startswith("on") for name in a)]


def test_names_of_plugins_are_text(html: str, read: Reader):
    """It is in a heading, in tables, in alternative texts and in figures; never as an element."""
    assert not [tag for tag, _ in read.elements if tag == "b" and "my" in tag]
    assert "<script>document.title" not in html
    assert len(read.scripts) == 1
    shown = " ".join(read.text)
    assert NASTY in shown
    assert any(NASTY in (a.get("aria-label") or "") for _, a in read.elements)
    figures = re.findall(r"<svg.*?</svg>", html, re.DOTALL)
    assert any("&lt;b&gt;my&lt;/b&gt; &amp;" in figure for figure in figures)
    assert not [tag for figure in figures for tag in re.findall(r"<(\w+)", figure) if tag not in SVG]


def test_ids_are_unique_and_links_lead_somewhere(html: str, read: Reader):
    ids = [a["id"] for _, a in read.elements if a.get("id")]
    assert len(ids) == len(set(ids))
    links = [a["href"] for tag, a in read.elements if tag == "a" and a.get("href")]
    assert len(links) > 12
    assert {link[1:] for link in links if link} <= set(ids)
    used = re.findall(r'(?:href="|url\()#([^")]+)', html)
    assert set(used) <= set(ids)
    labels = [a[name] for _, a in read.elements for name in ("aria-labelledby", "data-of") if a.get(name)]
    assert set(labels) <= set(ids)


def test_pictures_and_figures_have_words(read: Reader):
    assert all(a.get("alt") for tag, a in read.elements if tag == "img")
    plots = [a for _, a in read.elements if (a.get("class") or "").split()[:1] == ["plot"]]
    assert plots
    assert all(a.get("role") == "img" and a.get("aria-label") for a in plots)


def test_tables_have_the_measured_and_the_published_number(data: ReportData, read: Reader):
    figure = data.tables[0].rows[0][1].win
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


def test_warnings_stand_once_folded_before_any_number(data: ReportData, html: str):
    banner = html[html.index('<details class="banner" id="warnings">') : html.index('id="results"')]
    assert "<summary>⚠ 5 warnings: budget, seeds, physics, ties, tie meaning</summary>" in banner
    for warning in data.warnings:
        assert html.count(str(escape(warning.text))) == 1
        assert str(escape(warning.text)) in banner
    assert "plugin broke" in banner  # what is not finished, with its reason


def test_results_come_first_and_their_origin_last(html: str):
    titles = re.findall(r'<section id="(\w+)"', html)
    assert titles[:2] == ["results", "curves"]
    assert titles[-2:] == ["claims", "provenance"]


def test_parts_without_data_are_left_out(data: ReportData):
    lists = [name for name, value in data if isinstance(value, list) and name not in ("games", "settings")]
    html = render(data.model_copy(update={name: [] for name in lists}))
    assert re.findall(r'<section id="(\w+)"', html) == ["provenance"]
    for word in ("banner", "plot", "legend"):
        assert f'class="{word}"' not in html


def test_a_column_without_any_number_is_left_out(data: ReportData):
    table = data.tables[0]
    empty = [
        [
            cell if cell.column != NASTY else cell.model_copy(update={"scores": [], "win": Figure()})
            for cell in row
        ]
        for row in table.rows
    ]
    tables = [table.model_copy(update={"rows": empty})]
    html = render(data.model_copy(update={**WITHOUT_FIGURES, "tables": tables}))
    shown = html[html.index('id="table-t1-s1"') : html.index("</table>", html.index('id="table-t1-s1"'))]
    assert re.findall(r'class="name">([^<]+)<', shown) == data.columns[:-1]


def test_file_is_written_whole_and_again(data: ReportData, tmp_path: Path):
    path, short = tmp_path / "index.html", data.model_copy(update=WITHOUT_FIGURES)
    path.write_text("old")
    write_page(short, path)
    assert path.read_text("utf-8") == render(short)
    assert path.read_text("utf-8").endswith("</html>")
    assert [p.name for p in tmp_path.iterdir()] == ["index.html"]


def test_summary_does_not_crown_a_winner_within_noise(data: ReportData):
    row = data.tables[0].rows[0]
    best = max(row[1:], key=lambda cell: cell.win.measured.value if cell.win.measured else 0.0)
    rival = next(cell for cell in row[1:] if cell is not best)
    even = rival.model_copy(update={"win": best.win})
    table = data.tables[0].model_copy(update={"rows": [[row[0], best, even]]})
    clear, level = (bests(data.model_copy(update={"tables": [t]}))[0] for t in (data.tables[0], table))
    assert f"{best.column} won most often" in level
    assert f"within noise of {rival.column}" in level
    assert "within noise" not in clear

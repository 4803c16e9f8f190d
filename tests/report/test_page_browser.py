"""The report's page in a real browser: Chromium opens it, clicks through it and prints it."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from apil_core.studies.report.page import write_page
from report import page_sample
from report.page_sample import NASTY

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

CHROMIUM = os.environ.get("APIL_CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium (install it, or set APIL_CHROMIUM)")


@dataclass
class Visit:
    """The open page, and everything it complained of or asked for."""

    page: sync_api.Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def until(self, expression: str) -> None:
        """Wait for it to become true; playwright's own way needs ``eval``, which the page forbids."""
        end = time.monotonic() + 60
        while not self.page.evaluate(expression):
            assert time.monotonic() < end, expression
            time.sleep(0.02)

    def reset(self) -> None:
        """As it was opened: selectors, details, place."""
        self.page.evaluate(
            """() => {
                document.querySelectorAll("details").forEach((details) => { details.open = false; });
                scrollTo(0, 0);
                for (const form of document.querySelectorAll("form.selectors")) {
                    form.reset();
                    form.dispatchEvent(new Event("change"));
                }
            }"""
        )


@pytest.fixture(scope="module")
def visit(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visit]:
    path = tmp_path_factory.mktemp("page") / "index.html"
    write_page(page_sample.report_data(), path)
    with sync_api.sync_playwright() as playwright:
        flags = ["--no-sandbox"] if os.geteuid() == 0 else []  # Chromium refuses its sandbox to root
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="light")
        context.grant_permissions(["clipboard-read", "clipboard-write"])
        visit = Visit(context.new_page())
        visit.page.on("console", lambda message: visit.complaints.append(message.text))
        visit.page.on("pageerror", lambda error: visit.complaints.append(str(error)))
        visit.page.on("request", lambda request: visit.requests.append(request.url))
        visit.page.goto(path.as_uri(), timeout=120_000)
        visit.page.wait_for_selector("html[data-ready]", timeout=120_000)
        visit.page.add_style_tag(content="html { scroll-behavior: auto !important }")
        yield visit
        browser.close()


@pytest.fixture(autouse=True)
def _nothing_wrong(visit: Visit) -> Iterator[None]:
    """Whatever a test does: no error, no warning, no request that leaves the file."""
    visit.reset()
    yield
    assert visit.complaints == []
    assert [url for url in visit.requests if not url.startswith(("file:", "data:", "blob:"))] == []


def test_every_figure_has_its_place_and_nothing_is_wider_than_the_window(visit: Visit):
    visit.page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    sizes = visit.page.evaluate(
        """() => [...document.querySelectorAll("figure:not([hidden]) .plot svg")].map((svg) => {
            const box = svg.getBoundingClientRect();
            return [box.width, box.height];
        })"""
    )
    assert len(sizes) > 15
    assert all(width > 300 and height > 60 for width, height in sizes)
    assert _too_wide(visit, 1280) == []


def test_results_are_on_the_first_screen(visit: Visit):
    top = "document.querySelector('#results table tbody').getBoundingClientRect().top"
    assert visit.page.evaluate(top) < 600


def test_telephones_need_no_sideways_scrolling(visit: Visit):
    visit.page.set_viewport_size({"width": 400, "height": 900})
    visit.page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert _too_wide(visit, 400) == []
    visit.page.set_viewport_size({"width": 1280, "height": 900})


def test_no_request_could_leave(visit: Visit):
    """The policy is in force, not only in the file."""
    page = visit.page
    refused = page.evaluate("fetch('https://example.org/').then(() => 'left', () => 'refused')")
    assert refused == "refused"
    page.evaluate(
        "() => { const s = document.createElement('script'); s.textContent = 'window.ran = true';"
        " document.body.append(s); s.remove(); }"
    )
    assert page.evaluate("window.ran") is None
    assert any("example.org" in text for text in visit.complaints)
    visit.complaints.clear()  # they are the refusals
    assert not [url for url in visit.requests if url.startswith("http")]


def test_names_of_plugins_stay_words(visit: Visit):
    assert NASTY in visit.page.title()
    assert visit.page.locator("th .method", has_text=NASTY).first.is_visible()
    assert visit.page.locator("#aggregates svg text", has_text="<b>my</b>").count() == 4
    assert visit.page.locator("svg b, svg script").count() == 0


def test_toggle_recolours_page_and_figures(visit: Visit):
    page = visit.page
    before = _look(page)
    page.click("#theme")
    assert page.get_attribute("html", "data-theme") == "dark"
    assert page.inner_text("#theme") == "Light colours"
    dark = _look(page)
    assert all(one != other for one, other in zip(before, dark, strict=True))
    page.click("#theme")
    assert _look(page) == before


def test_system_setting_is_followed(visit: Visit):
    page = visit.page
    page.evaluate("() => { localStorage.clear(); delete document.documentElement.dataset.theme; }")
    light = _look(page)[0]
    page.emulate_media(color_scheme="dark")
    assert _look(page)[0] != light
    page.emulate_media(color_scheme="light")
    assert _look(page)[0] == light


def test_selectors_show_what_they_say(visit: Visit):
    checked = visit.page.evaluate(
        """() => [...document.querySelectorAll("form.selectors input")].map((radio) => {
            radio.click();
            const section = radio.closest("section"), value = radio.value;
            const shown = [...section.querySelectorAll("figure[data-facets]:not([hidden])")];
            const none = !section.querySelector(".none-left").hidden;
            const facets = shown.map((figure) => JSON.parse(figure.dataset.facets)[radio.dataset.facet]);
            const right = facets.every((facet) => value === "" || value.split("|").includes(facet));
            return [radio.name, value, right && none === (shown.length === 0)];
        })"""
    )
    assert len(checked) > 15
    assert [choice for choice in checked if not choice[2]] == []


def test_one_game_and_measure_fill_the_row(visit: Visit):
    page = visit.page
    form = page.locator("#curves form")
    form.scroll_into_view_if_needed()
    figure = page.locator("#curves figure").first
    half = figure.bounding_box()
    form.locator("label", has_text="kick-and-defend").click()
    page.keyboard.press("Tab")  # to the other group of radio buttons
    page.keyboard.press("ArrowRight")
    assert form.locator("input[value=win]").is_checked()
    assert page.locator("#curves figure:not([hidden])").count() == 1
    whole = figure.bounding_box()
    assert half
    assert whole
    assert whole["width"] > 1.8 * half["width"]


def test_a_link_to_the_warnings_opens_them(visit: Visit):
    assert not visit.page.locator("#warnings li").first.is_visible()
    visit.page.click(".contents a[href='#warnings']")
    visit.until("document.getElementById('warnings').open")


def test_details_open_by_keyboard(visit: Visit):
    page = visit.page
    for summary in page.locator("#tables details > summary").all()[:3]:
        summary.focus()
        page.keyboard.press("Enter")
        assert summary.evaluate("(s) => s.parentElement.open")


def test_tables_can_be_copied_and_saved(visit: Visit):
    page = visit.page
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    buttons = page.locator("button.copier").all()
    data = page_sample.report_data()
    assert len(buttons) == 2 * len(data.tables) + 4  # aggregates as LaTeX and CSV; profiles and improvements
    for button in buttons:
        button.evaluate("(b) => b.click()")
        text = page.locator(f"#{button.get_attribute('data-of')}").text_content()
        visit.until("document.getElementById('said').textContent === 'Copied'")
        assert page.evaluate("navigator.clipboard.readText()") == text
        page.evaluate("document.getElementById('said').textContent = ''")
    with page.expect_download() as download:
        page.locator("button.saver").first.click()
    assert download.value.suggested_filename == "t1-s1.tex"
    expected = page.locator("#copy-t1-s1-tex").text_content()
    assert Path(download.value.path()).read_text("utf-8") == expected


def test_print_holds_everything_in_light_colours(visit: Visit):
    page = visit.page
    light = _look(page)
    page.click("#theme")
    dark = _look(page)
    page.evaluate(
        """() => addEventListener("beforeprint", () => {
            window.printed = document.querySelectorAll("details:not([open]):not(.screen)").length;
        }, { once: true })"""
    )
    file = page.pdf(prefer_css_page_size=True, print_background=True)
    assert file.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", file)) > 5
    assert page.evaluate("window.printed") == 0
    page.emulate_media(media="print")
    assert _look(page) == light
    styles = "[...document.querySelectorAll('figure')].map((figure) => getComputedStyle(figure).display)"
    assert "none" not in page.evaluate(styles)
    page.emulate_media(media="screen")
    assert page.locator("details[open]").count() == 0
    assert _look(page) == dark
    page.click("#theme")


def test_contents_lead_to_every_section(visit: Visit):
    places = visit.page.evaluate(
        """() => [...document.querySelectorAll(".contents a")].map((link) => {
            link.click();
            const end = scrollY + innerHeight >= document.documentElement.scrollHeight - 2;
            const top = document.querySelector(link.hash).getBoundingClientRect().top;
            return [link.textContent, end ? 0 : top];
        })"""
    )
    assert len(places) > 15
    assert [place for place in places if not -5 < place[1] < 60] == []


def _too_wide(visit: Visit, width: int) -> list[str]:
    """Elements that reach beyond the window, but for what scrolls on its own."""
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= width
    found: list[str] = visit.page.evaluate(
        """(width) => [...document.querySelectorAll("main *")]
            .filter((e) => e.getBoundingClientRect().right > width + 1 && !e.closest(".scroll, pre, svg *"))
            .map((e) => e.outerHTML.slice(0, 80))""",
        width,
    )
    return found


def _look(page: sync_api.Page) -> list[str]:
    """Colours of the page's ground, of a figure's words, and of a method's mark in it."""
    found: list[str] = page.evaluate(
        """() => {
            const colour = (selector) => getComputedStyle(document.querySelector(selector)).fill;
            return [getComputedStyle(document.body).backgroundColor, colour("#aggregates svg text"),
                    colour("#aggregates svg use[style*='line-1']")];
        }"""
    )
    return found

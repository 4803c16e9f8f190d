"""The site: gathered from the whole repository, complete, and strict about what it finds."""

from __future__ import annotations

import html
import re
import subprocess
import sys
from pathlib import Path, PurePosixPath
from types import ModuleType

import pytest
from cli.cli_helpers import VERBS

import apil_core.testing
from apil_core.api.hookspecs import RunHooks
from apil_core.api.specs import options_model
from apil_core.config.resolve import flatten
from apil_core.plugins.discovery import discover
from docs.pages import ROOT, blocks

SITE = ROOT / "docs" / "site"
FAQ = ROOT / "docs" / "faq.md"


def module(name: str) -> ModuleType:
    """One of the scripts in docs/site/, which are no package."""
    for library in ("latex2mathml", "griffe"):
        pytest.importorskip(library)
    sys.path.insert(0, str(SITE))
    try:
        return __import__(name)
    finally:
        sys.path.remove(str(SITE))


@pytest.fixture(scope="module")
def gathered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site's sources; gathering fails on a link to nowhere and on a page the navigation lacks."""
    work = tmp_path_factory.mktemp("site")
    module("build_site").gather(work)
    return work / "docs"


# --- what is gathered


def test_every_page_of_the_repository_has_its_place(gathered: Path) -> None:
    for place in module("site_sources").page_places().values():
        assert (gathered / place).is_file()
    assert (gathered / "methods" / "e_apil.md").is_file()
    assert (gathered / "examples" / "simple_push.md").is_file()


def test_links_between_pages_follow_them_to_their_places(gathered: Path) -> None:
    assert "](methods/apil.md#options)" in (gathered / "methods.md").read_text()
    assert "](../pettingzoo.md)" in (gathered / "examples" / "simple_push.md").read_text()
    assert "](source/apil_core/api/types.py.md)" in (gathered / "hooks.md").read_text()
    assert "class StepBatch" in (gathered / "source" / "apil_core" / "api" / "types.py.md").read_text()


def test_markers_of_tests_are_gone_and_code_is_as_it_was(gathered: Path) -> None:
    text = (gathered / "hooks.md").read_text()
    assert "<!--" not in text
    for block in blocks(ROOT / "docs" / "hooks.md"):
        assert block.text in text


def test_the_command_line_is_there_to_the_last_verb_and_flag(gathered: Path) -> None:
    text = (gathered / "cli.md").read_text()
    for verb in VERBS:
        assert f"\n## `apil {verb}`\n" in text
    assert "\n### `apil bench run`\n" in text
    assert "* `--blind-imitator`: " in text


def test_every_option_of_every_plugin_is_there(gathered: Path) -> None:
    rows = [line for line in (gathered / "settings.md").read_text().splitlines() if line.startswith("| `")]
    keys = {row.split("`")[1] for row in rows}
    plugins = discover()
    for spec in plugins.methods.values():
        if spec.config:
            defaults = options_model(spec.config)().model_dump(mode="json")
            assert set(flatten(defaults, f"options.{spec.name}.")) <= keys
    assert {"steps", "ppo.learning_rate", "game.max_steps", "game.kwargs", "game.auto_contact"} <= keys
    (row,) = (row for row in rows if row.startswith("| `ppo.gamma`"))
    assert row == "| `ppo.gamma` | number > 0, ≤ 1 | `0.99` | Discount per step. |"


def test_a_method_says_which_presets_change_it(gathered: Path) -> None:
    text = (gathered / "methods" / "apl.md").read_text()
    assert "| `apl-code` | `options.apl.advantage_difference` | `true` |" in text
    assert "It has no options of its own." in (gathered / "methods" / "adrl.md").read_text()


def test_every_public_name_is_in_the_python_reference(gathered: Path) -> None:
    pages = {page.stem: page.read_text() for page in (gathered / "reference").glob("*.md")}
    for name in {*apil_core.__all__, *apil_core.testing.__all__} - {"__version__"}:
        (page,) = re.findall(rf"^\| \[`{name}`\]\((\w+)\.md#{name.lower()}\)", pages["index"], re.M)
        assert f"## `{name}`\n\n```python\n" in pages[page]
    assert ":class:" not in "".join(pages.values())
    assert "gae(\n    rewards: Tensor,\n    values: Tensor,\n" in pages["learning"]
    assert "- `gamma` (`float`): discount per step.\n" in pages["learning"]
    assert "- `reward, victim_reward`: r^α and r^ν in the units of [docs/methods.md]" in pages["types"]
    assert "- `ApilError`: one line per mistake" in pages["configuration"]
    assert "### `GameVectorEnv.step`\n" in pages["environments"]


# --- what is refused


def test_a_link_to_nowhere_is_told(tmp_path: Path) -> None:
    sources = module("site_sources")
    (tmp_path / "docs").mkdir()
    for name in sources.MOVED:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("text")
    (tmp_path / "docs" / "page.md").write_text("`[no](link)` and [a link](../gone.py)")
    with pytest.raises(sources.SiteError, match=re.escape("docs/page.md: ../gone.py: no such file")):
        sources.Sources(tmp_path / "out", root=tmp_path).write({}, {})


def test_the_navigation_names_all_pages_and_no_others() -> None:
    build = module("build_site")
    pages = {PurePosixPath(name) for name in ("a.md", "m/x.md", "m/y.md")}
    assert build.spelt_out(["a.md", {"M": ["m/y.md", "m/*"]}], pages) == ["a.md", {"M": ["m/y.md", "m/x.md"]}]
    with pytest.raises(build.SiteError, match="nav lacks m/x.md"):
        build.spelt_out(["a.md", "m/y.md"], pages)
    with pytest.raises(build.SiteError, match="names b.md, which does not exist"):
        build.spelt_out(["a.md", "b.md", "m/*"], pages)


def test_built_pages_are_searched_for_dead_ends_and_for_loads_from_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<h1 id="top"></h1><a href="b.html#here">x</a><a href="https://elsewhere.org">fine</a>'
        '<a href="c.html">x</a><a href="#bottom">x</a><script src="https://cdn.org/x.js"></script>'
    )
    (tmp_path / "b.html").write_text('<p id="here"></p><img src="gone.png"><a href="a.html#top">x</a>')
    assert module("site_check").problems(tmp_path) == [
        "a.html: loads https://cdn.org/x.js from elsewhere",
        "a.html: c.html: no such file",
        "a.html: #bottom: no such heading",
        "b.html: gone.png: no such file",
    ]


# --- formulas


def test_formulas_become_mathml() -> None:
    markdown = pytest.importorskip("markdown")
    text = "a $r^\\alpha$, `$x$`, 5 $ or 6 $, \\$y$\n\n$$\\frac{a_1}{2}$$\n"
    made = markdown.markdown(text, extensions=[module("site_math").MathExtension()])
    assert made.count("<math") == 2
    assert "<msup><mi>r</mi><mi>&#x003B1;</mi></msup>" in made
    assert "<mfrac><mrow><msub><mi>a</mi><mn>1</mn></msub></mrow><mrow><mn>2</mn></mrow></mfrac>" in made
    assert "<code>$x$</code>, 5 $ or 6 $" in made


def test_what_browsers_and_the_converter_do_not_know_is_mended() -> None:
    mathml = module("site_math").mathml
    assert ">‖</mo>" in mathml(r"\big\lVert x \big\rVert", display=False)
    assert ">|</mo>" in mathml(r"\Big\lvert x \Big\rvert", display=False).replace("&#x0007C;", "|")
    assert "<mi>𝒩</mi>" in mathml(r"\mathcal N", display=False)
    assert "<munder><mo>max</mo><mi>x</mi></munder>" in mathml(r"\max_x x", display=True)
    assert "<msub><mo>max</mo><mi>x</mi></msub>" in mathml(r"\max_x x", display=False)


def test_tex_that_is_not_understood_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"unknown TeX \\nosuch in"):
        module("site_math").mathml(r"a \nosuch b", display=False)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_picture_has_every_hook_of_a_run(scheme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import make_flow

    picture = (ROOT / "docs" / "images" / f"data-flow-{scheme}.svg").read_text("utf-8")
    assert picture == make_flow.draw(scheme), "python docs/make_flow.py"
    shown = {html.unescape(text) for text in re.findall(r'class="hook">([^<]+)<', picture)}
    assert shown == {name for name, value in vars(RunHooks).items() if hasattr(value, "apil_spec")}


# --- questions and errors


def test_messages_in_the_headings_are_those_of_the_code() -> None:
    sources = "".join(path.read_text("utf-8") for path in sorted((ROOT / "apil_core").rglob("*.py")))
    sources = re.sub(r'"\s*\n\s*f?"', "", sources)  # texts written over several lines
    shown = "".join(block.text for block in blocks(FAQ, "console"))
    headings = re.findall(r"^### (.+)$", FAQ.read_text("utf-8"), re.M)
    messages = [code for heading in headings for code in re.findall(r"`([^`]+)`", heading)]
    assert len(messages) > 15
    for message in messages:
        if len(message.split()) < 3 or message in ("apil: command not found", "has no attribute"):
            continue  # commands, and what the shell or Python says
        pieces = [piece.strip() for piece in re.split(r"…|'[^']*'|[0-9]+|: |, ", message)]
        assert any(len(p) > 9 and (p in sources or p in shown) for p in pieces), message


# --- the whole


@pytest.mark.slow
def test_pages_read_alike_on_github_and_on_the_site(gathered: Path) -> None:
    """Two dialects of Markdown: what one takes for a list or a table the other must, too."""
    from markdown import markdown
    from markdown_it import MarkdownIt

    github = MarkdownIt("commonmark").enable("table")
    extensions = ["tables", "pymdownx.superfences", module("site_math").MathExtension()]
    for page in sorted(gathered.rglob("*.md")):
        if page.relative_to(gathered).parts[0] == "source":
            continue
        text = page.read_text()
        both = github.render(text), markdown(text, extensions=extensions)
        for tag in ("h2", "h3", "li", "ul", "ol", "table", "tr", "td", "pre", "img"):
            there, here = (len(re.findall(rf"<{tag}[ >/]", made)) for made in both)
            assert there == here, (
                f"{page.relative_to(gathered)}: {there} × {tag} on GitHub, {here} on the site"
            )


@pytest.mark.slow
def test_the_site_is_built_strictly(tmp_path: Path) -> None:
    """What ``make docs`` does, in CI too (.ci/run)."""
    pytest.importorskip("zensical")
    command = [sys.executable, str(SITE / "build_site.py"), "--out", str(tmp_path / "site")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    page = (tmp_path / "site" / "methods" / "apil.html").read_text()
    assert "<math" in page
    assert "$$" not in page
    assert (tmp_path / "site" / "search.json").stat().st_size > 100_000

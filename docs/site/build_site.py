"""Builds the documentation site, strictly: any broken link, missing page or request to elsewhere is an error.

    python docs/site/build_site.py [--out site]

Gathers the sources into a temporary folder (site_sources.py), lets Zensical build them, then checks what came
out (site_check.py). The site is complete in itself: no fonts, scripts or formulas from elsewhere.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from ruamel.yaml import YAML
from site_check import problems
from site_python import reference_pages
from site_reference import cli_page, config_page, method_addendum
from site_sources import ROOT, SiteError, Sources

import apil_core.testing
from apil_core.plugins.discovery import discover

CONFIG = ROOT / "mkdocs.yml"
HERE = Path(__file__).resolve().parent
_MADE = """
Only on this site, made from the code: the [command line](cli.md), [every setting](settings.md) and the
[Python reference](reference/index.md).
"""


def main(arguments: list[str] | None = None) -> int:
    """Build, check, put in place; 1 with one line per problem if anything is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "site", help="folder of the site, replaced")
    out = parser.parse_args(arguments).out
    with tempfile.TemporaryDirectory(prefix="apil-site-") as name:
        work = Path(name).resolve()
        try:
            gather(work)
            generate(work)
            found = problems(work / "site")
        except SiteError as error:
            found = [str(error)]
        if found:
            print("\n".join(found), file=sys.stderr)
            return 1
        if out.exists() and any(out.iterdir()) and not (out / "sitemap.xml").is_file():
            print(f"{out}: not empty and no site built before: choose another --out", file=sys.stderr)
            return 1
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(work / "site", out)
    print(f"{out}: {sum(1 for _ in out.rglob('*.html'))} pages")
    return 0


def gather(work: Path) -> None:
    """``work/docs`` with all sources, and ``work/mkdocs.yml`` with the navigation spelt out.

    Raises:
        SiteError: a link leads nowhere, or the navigation and the pages do not fit.
    """
    yaml = YAML()
    config = yaml.load(CONFIG.read_text("utf-8"))
    plugins = discover()
    sources = Sources(work / "docs", str(config.get("extra", {}).get("source_url") or ""))
    methods = [place for place in sources.places.values() if place.parts[0] in ("methods", "examples")]
    addenda = {place: method_addendum(place.stem, plugins) for place in methods}
    addenda[sources.places[PurePosixPath("docs/README.md")]] = _MADE
    public = {*apil_core.__all__, *apil_core.testing.__all__} - {"__version__"}
    made = {"cli.md": cli_page(), "settings.md": config_page(plugins), **reference_pages(public)}
    sources.write(addenda, made)
    pages = {PurePosixPath(page.relative_to(work / "docs")) for page in (work / "docs").rglob("*.md")}
    config["nav"] = spelt_out(config["nav"], {page for page in pages if page.parts[0] != "source"})
    config["docs_dir"], config["site_dir"] = "docs", "site"
    with (work / "mkdocs.yml").open("w", encoding="utf-8") as file:
        yaml.dump(config, file)


def spelt_out(nav: list[Any], pages: set[PurePosixPath]) -> list[Any]:
    """The navigation with ``folder/*`` replaced by that folder's pages that are not named themselves.

    Raises:
        SiteError: a page it names is missing, or a page is not in it.
    """
    named = {PurePosixPath(path) for path in _paths(nav) if not path.endswith("/*")}
    missing = sorted(map(str, named - pages))
    full = _expanded(nav, pages - named)
    left = sorted(map(str, pages - {PurePosixPath(path) for path in _paths(full)}))
    if missing or left:
        lines = [f"mkdocs.yml: nav names {path}, which does not exist" for path in missing]
        lines += [f"mkdocs.yml: nav lacks {path}" for path in left]
        raise SiteError("\n".join(lines))
    return full


def _paths(nav: Any) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    elif isinstance(nav, dict):
        for value in nav.values():
            yield from _paths(value)
    else:
        for entry in nav:
            yield from _paths(entry)


def _expanded(nav: list[Any], free: set[PurePosixPath]) -> list[Any]:
    full: list[Any] = []
    for entry in nav:
        if isinstance(entry, str) and entry.endswith("/*"):
            full += sorted(str(page) for page in free if str(page.parent) == entry[:-2])
        elif isinstance(entry, dict):
            full.append({k: _expanded(v, free) if isinstance(v, list) else v for k, v in entry.items()})
        else:
            full.append(entry)
    return full


def generate(work: Path) -> None:
    """``work/site`` from what :func:`gather` wrote.

    Raises:
        SiteError: Zensical found something wrong; all it said.
    """
    path = os.pathsep.join(filter(None, [str(HERE), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict", "--clean"],
        cwd=work,
        env={**os.environ, "PYTHONPATH": path, "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    said = re.sub(r"\x1b\[[0-9;]*m", "", done.stdout + done.stderr)
    # it may print an error and still exit with 0 (zensical issue 491)
    if (
        done.returncode
        or re.search(r"^(Error|Warning)", said, re.M)
        or not (work / "site/index.html").is_file()
    ):
        raise SiteError(said.strip())


if __name__ == "__main__":
    sys.exit(main())

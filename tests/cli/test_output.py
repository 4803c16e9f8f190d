"""Names of others on the screen and in reports: text, never markup, control codes, formulas or links."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from report.page_sample import WITHOUT_FIGURES, report_data

from apil_core.cli.output import console, print_json, styled, table
from apil_core.cli.progress import PlainProgress
from apil_core.studies.report.page import render
from apil_core.studies.report.tables import csv_text, write_tables
from cli.cli_helpers import Apil

NAME = "python:snake:play [x] [/b] \x1b[2J\x9b\u202e\udc80"
SHOWN = r"python:snake:play [x] [/b] \u001b[2J\u009b\u202e\udc80"


def test_names_are_shown_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    rows = table("name", NAME)
    rows.add_row(NAME, styled(NAME, "red"))
    console().print(rows)
    console().print(NAME)
    print_json({"name": NAME})
    PlainProgress().note(NAME)
    out, err = capsys.readouterr()
    assert out.count(SHOWN) == 5
    assert err == f"{SHOWN}\n"
    assert json.loads(out[out.index("{") :])["name"] == NAME


def test_errors_are_shown_as_they_are(apil: Apil, tmp_path: Path) -> None:
    done = apil("resume", NAME)
    assert (done.code, done.err.startswith(f"apil: {SHOWN} is no run directory")) == (2, True)
    (tmp_path / NAME).mkdir(parents=True)
    (tmp_path / NAME / "config.yaml").write_text("nothing")
    listed = apil("runs", "list", ".")
    assert (listed.code, SHOWN in listed.out, listed.err) == (0, True, "")


def test_a_report_has_no_formula_html_or_control_code(tmp_path: Path) -> None:
    assert csv_text([{"a": "=1+1", "b": "-x", "c": -0.5, "d": "@x", "e": "+1", "f": "a=1"}]) == (
        "a,b,c,d,e,f\n'=1+1,'-x,-0.5,'@x,'+1,a=1\n"
    )
    data = report_data(nasty=False)
    dots = [data.aggregates[0].model_copy(update={"column": NAME[-4:]})]
    nasty = f"<img src=x>{NAME}"
    tables = [data.tables[0].model_copy(update={"title": nasty})]
    found = data.model_copy(update={**WITHOUT_FIGURES, "title": nasty, "tables": tables, "aggregates": dots})
    written = [path.read_text("utf-8") for path in write_tables(found, tmp_path)]
    html = render(found)
    html.encode()
    assert f"&lt;img src=x&gt;{SHOWN}" in html
    assert SHOWN[-18:] in html[html.index("<svg") :]
    assert not any(code in text for text in (html, *written) for code in "\x1b\x9b\u202e\udc80")


@pytest.mark.parametrize("words", [["--help"], ["games"], ["methods", "--json"]])
def test_a_closed_pipe_ends_the_program_quietly(words: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "apil_core.cli", *words]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")

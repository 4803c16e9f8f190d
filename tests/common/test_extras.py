"""Libraries that only extras bring."""

from __future__ import annotations

import json
from importlib import metadata

import pytest
from packaging.requirements import Requirement

from apil_core import ApilError
from apil_core.common import extras


def test_each_extra_named_is_one_of_the_package_and_brings_that_library():
    required = metadata.requires("apil") or []
    for module, (library, _, extra) in extras._EXTRAS.items():
        name = {"PyAV": "av"}.get(library, library)
        wanted = [line for line in required if f'extra == "{extra}"' in line.replace("'", '"')]
        assert any(line.startswith(name) for line in wanted), (module, wanted)


def test_what_is_missing_is_one_line_with_its_extra(monkeypatch):
    monkeypatch.setitem(extras._EXTRAS, "not_there_at_all", ("Nothing", "tests", "test"))
    with pytest.raises(ApilError, match="^tests need Nothing: pip install"):
        extras.need("math", "not_there_at_all")
    assert extras.missing("not_there_at_all.part") is not None
    assert extras.missing("some_module_of_a_plugin") is None


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        ({}, "pip install 'apil[ray]'"),
        (
            {"url": "file:///my%20code/apil", "dir_info": {"editable": True}},
            "pip install -e '/my code/apil[ray]'",
        ),
        ({"url": "file:///code/apil", "dir_info": {}}, "pip install 'apil[ray] @ file:///code/apil'"),
        ({"url": "file:///apil-1-py3.whl"}, "pip install 'apil[ray] @ file:///apil-1-py3.whl'"),
        (
            {"url": "https://host/a/apil", "vcs_info": {"vcs": "git", "commit_id": "0a81e38"}},
            "pip install 'apil[ray] @ git+https://host/a/apil@0a81e38'",
        ),
    ],
)
def test_the_command_that_adds_an_extra_suits_where_apil_came_from(origin, command):
    assert extras._command("ray", origin) == command
    if "-e" not in command:
        assert Requirement(command.split("'")[1]).extras == {"ray"}


def test_this_installations_command_names_its_origin():
    origin = metadata.distribution("apil").read_text("direct_url.json")
    assert extras.install_command("ray") == extras._command("ray", json.loads(origin or "{}"))

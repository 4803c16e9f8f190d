"""Libraries that only extras bring."""

from __future__ import annotations

from importlib import metadata

import pytest

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
    with pytest.raises(ApilError, match=r"^tests need Nothing: pip install 'apil\[test\]'$"):
        extras.need("math", "not_there_at_all")
    assert extras.missing("not_there_at_all.part") is not None
    assert extras.missing("some_module_of_a_plugin") is None

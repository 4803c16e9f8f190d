"""Import rules (docs/architecture.md), read from the source, so that lazy imports count."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (
    *("common", "api", "plugins", "config", "policies", "games", "training"),
    *("evaluation", "runs", "studies", "testing", "cli"),
)
"""Each may import only those before it."""
PLUGINS = {"apil_adrl": set(), "apil_apl": set(), "apil_apil": {"apil_apl"}, "apil_e_apil": {"apil_apil"}}


def imports(path: Path):
    """All (module, name) imported anywhere in a file; name is None for ``import module``."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from ((node.module or "", alias.name) for alias in node.names)


def sources(folder: str):
    found = sorted((ROOT / folder).rglob("*.py"))
    assert found, folder
    return found


def outsiders():
    for folder in ("envs/apil_envs", *(f"plugins/{name[5:]}/{name}" for name in PLUGINS)):
        yield from sources(folder)


@pytest.mark.parametrize("path", list(outsiders()), ids=lambda p: str(p.relative_to(ROOT)))
def test_plugins_and_games_use_the_public_api_only(path):
    import apil_core
    import apil_core.testing

    package = path.relative_to(ROOT).parts[-2] if path.parent.name.startswith("apil_") else None
    package = package or next(part for part in path.parts if part.startswith("apil_"))
    allowed = {package} | PLUGINS.get(package, set())
    for module, name in imports(path):
        top = module.split(".")[0]
        if top == "apil_core":
            public = {"apil_core": apil_core.__all__, "apil_core.testing": apil_core.testing.__all__}
            assert module in public, f"{path}: imports {module}, not the public apil_core"
            assert name in public[module], f"{path}: {name} is not public"
        elif top.startswith("apil_"):
            assert top in allowed, f"{path}: imports {top} without requiring it"
            assert top == package or module == top, f"{path}: reaches into {module}"


def test_the_core_imports_no_plugin_and_no_game():
    for path in sources("apil_core"):
        for module, _ in imports(path):
            top = module.split(".")[0]
            assert not top.startswith("apil_") or top == "apil_core", f"{path} imports {module}"


def test_rsl_rl_and_rich_have_one_home():
    for path in sources("apil_core"):
        inside = path.relative_to(ROOT / "apil_core")
        for module, _ in imports(path):
            top = module.split(".")[0]
            home = str(inside) in ("training/ppo.py", "training/ppo_storage.py")
            assert top != "rsl_rl" or home, f"{path} imports rsl_rl"
            assert top not in ("rich", "cyclopts") or inside.parts[0] == "cli", f"{path} imports {top}"
            assert not module.startswith("apil_core.cli") or inside.parts[0] == "cli", f"{path} imports cli"


def test_folders_import_one_way_only():
    """Lazy and typing imports count, and so do the places that loader strings name."""
    core = ROOT / "apil_core"
    assert {path.name for path in core.iterdir() if (path / "__init__.py").exists()} == set(FOLDERS)
    for path in sources("apil_core"):
        here = path.relative_to(core).parts[0]
        if here not in FOLDERS:
            continue  # the public names
        named = re.findall(r'"apil_core\.(\w+)[\w.]*:', path.read_text())
        for module, name in imports(path):
            package, _, inside = module.partition(".")
            named += [inside.partition(".")[0] or name] if package == "apil_core" else []
        for folder in set(named) & set(FOLDERS):
            assert FOLDERS.index(folder) <= FOLDERS.index(here), f"{path}: {here} may not import {folder}"


def test_the_public_api_lists_what_it_has():
    import apil_core

    for name in apil_core.__all__:
        assert getattr(apil_core, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        apil_core.nonsense


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        (
            "from apil_core.plugins.discovery import discover; discover()",
            {"torch", "mujoco", "numpy.random"},
        ),
        (
            "from apil_core import ApilError, RunConfig, define; RunConfig.load('paper')",
            {"torch", "mujoco", "pandas", "matplotlib"},
        ),
    ],
)
def test_finding_plugins_and_reading_settings_loads_nothing_heavy(code, heavy):
    code = f"import sys; {code}; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

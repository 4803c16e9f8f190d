"""``apil config``, and the lists of what there is."""

from __future__ import annotations

import json
from pathlib import Path

from cli.cli_helpers import COIN, Apil


def test_show_prints_a_file_that_gives_the_same_config(apil: Apil, tmp_path: Path) -> None:
    flags = (
        "--env",
        "coin",
        "--plugin",
        COIN,
        "--preset",
        "apil-code",
        "--steps",
        "2M",
        "--set",
        "game.margin=1",
    )
    shown = apil("config", "show", *flags)
    (tmp_path / "mine.yaml").write_text(shown.out)
    again = apil("config", "show", "--config", "mine.yaml", "--json", "--trust")
    assert (shown.code, again.code) == (0, 0)
    assert json.loads(again.out) == json.loads(apil("config", "show", *flags, "--json").out)
    config = json.loads(again.out)
    assert (config["steps"], config["game"], config["method"]) == (2_000_000, {"margin": 1.0}, "apil")


def test_validate_accepts_what_show_printed(apil: Apil, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(apil("config", "show", "--env", "coin", "--plugin", COIN).out)
    done = apil("config", "validate", "mine.yaml", "--trust")
    assert (done.code, done.out) == (0, "mine.yaml: valid (e_apil on coin, 35,000,000 steps)\n")
    assert json.loads(apil("config", "validate", "mine.yaml", "--json", "--trust").out)["valid"] is True


def test_validate_looks_for_what_a_file_names(apil: Apil, tmp_path: Path) -> None:
    """Every key is checked, though a plugin may not be loaded, and none of the code it names is run."""
    Path("agents.py").write_text("open('ran', 'w')")
    wrong = {"victim": "sb3:nofile.zip", "init_from": "nowhere", "steps": 1000, "env": "toy-pursuit"}
    Path("wrong.yaml").write_text(json.dumps({**wrong, "plugins": ["agents.py"]}))
    told = json.loads(apil("config", "validate", "wrong.yaml", "--json").out)
    assert not told["valid"]
    first, *others = told["errors"]
    assert first.startswith(f"{tmp_path}/agents.py runs code when it is loaded, and wrong.yaml names it")
    assert others == [
        "wrong.yaml: victim: sb3:nofile.zip: nofile.zip: no such file",
        f"wrong.yaml: init_from: {tmp_path}/nowhere is neither a directory nor a policy's name like "
        "zoo:GAME/ROLE/v1",
    ]
    for victim, reason in (
        ("zooo:x", "unknown policy 'zooo:x'"),
        ("zoo:kick-and-defend/kicker/v9", "unknown victim 'zoo:kick-and-defend/kicker/v9'"),
        ("embedded:kick-and-defend/kicker/v9", "unknown"),
        ("run:nowhere", "run:nowhere: nowhere: no such file"),
    ):
        Path("wrong.yaml").write_text(json.dumps({"victim": victim}))
        done = apil("config", "validate", "wrong.yaml")
        assert (done.code, done.err.count("\n")) == (2, 1), done
        assert reason in done.err
    for victim in ("python:agents:kick", "random", "auto", "embedded:kick-and-defend/kicker/v1"):
        Path("fine.yaml").write_text(json.dumps({"victim": victim}))
        assert apil("config", "validate", "fine.yaml").code == 0
    assert not Path("ran").exists()


def test_diff_completes_a_preset_with_the_other_sides_method_and_game(apil: Apil, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("method: adrl\nenv: coin\nseed: 3\n")
    done = apil("config", "diff", "paper", "mine.yaml", "--plugin", COIN, "--json")
    assert json.loads(done.out) == {"seed": {"first": 0, "second": 3}}
    assert "seed" in apil("config", "diff", "paper", "mine.yaml", "--plugin", COIN).out
    assert apil("config", "diff", "mine.yaml", "mine.yaml", "--plugin", COIN).out == "no difference\n"


def test_schema_is_json_with_the_methods_options(apil: Apil) -> None:
    schema = json.loads(apil("config", "schema", "--method", "e_apil").out)
    sections = set(schema["$defs"]["MethodOptions"]["properties"])
    assert sections & {"apl", "apil", "e_apil", "imap"} == {"apl", "apil", "e_apil"}  # and observers
    assert apil("config", "schema", "--method", "x").code == 2


def test_flags_add_plugins_to_those_a_file_names(apil: Apil, tmp_path: Path) -> None:
    (tmp_path / "other_plugin.py").write_text('"""Nothing to offer."""\n')
    (tmp_path / "mine.yaml").write_text("plugins: [other_plugin.py]\nenv: coin\n")
    shown = apil("config", "show", "--config", "mine.yaml", "--plugin", COIN, "--json", "--trust")
    assert json.loads(shown.out)["plugins"] == [str(tmp_path / "other_plugin.py"), str(COIN)]


def test_methods_games_and_plugins_are_listed(apil: Apil) -> None:
    methods = {row["name"]: row for row in json.loads(apil("methods", "--json").out)}
    assert methods["e_apil"]["requires"] == ["apil"]
    games = {row["name"] for row in json.loads(apil("games", "--plugin", COIN, "--json").out)}
    assert "coin" in games
    plugins = {row["name"]: row for row in json.loads(apil("plugins", "--plugin", COIN, "--json").out)}
    assert plugins["coin_game"]["games"] == ["coin"]
    assert plugins["runs"]["hooks"] == ["register_policies", "register_recorders"]
    assert "coin" in apil("games", "--plugin", COIN).out
    assert "the larger sum wins" in apil("games", "--plugin", COIN).out
    assert "e_apil" in apil("methods").out


def test_a_broken_installed_plugin_is_shown_with_its_error(apil: Apil, monkeypatch) -> None:
    from apil_core.plugins.discovery import PluginRecord, PluginRegistry

    record = PluginRecord("bad", "1.0", "entry point bad", error="ImportError: [x] missing")
    monkeypatch.setattr("apil_core.plugins.discovery.discover", lambda files: PluginRegistry([record]))
    done = apil("plugins")
    assert done.code == 1
    assert "ImportError: [x] missing" in done.out
    assert json.loads(apil("plugins", "--json").out)[0]["error"] == "ImportError: [x] missing"


def test_victims_are_listed_with_the_way_to_get_them(apil: Apil) -> None:
    done = apil("victims", "list")
    assert "zoo:kick-and-defend/kicker/v1" in done.out
    assert "apil victims import DIR" in done.out
    rows = json.loads(apil("victims", "list", "--json").out)
    assert not any(row["available"] for row in rows if row["name"].startswith("zoo:"))

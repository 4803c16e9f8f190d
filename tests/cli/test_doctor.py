"""What ``apil doctor`` finds: each check against the real thing, broken on purpose."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from apil_core.cli.doctor_checks import Finding, Report, Scope, find_plugins, guarded, offers
from apil_core.cli.doctor_checks.probes import TrialError, attempt
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.policies import zoo_cache as cache
from apil_core.policies import zoo_catalogue as catalogue
from cli.cli_helpers import COIN

WILD = Path(__file__).with_name("wild_games.py")


def statuses(findings: list[Finding]) -> dict[str, str]:
    return {finding.check: finding.status for finding in findings}


# --- plugins and presets


def test_a_broken_plugin_has_its_line_and_the_others_work(tmp_path: Path) -> None:
    broken = tmp_path / "broken_for_doctor.py"
    broken.write_text("import no_such_module_at_all\n")
    registry, nothing = find_plugins([broken, tmp_path / "missing.py", COIN])
    assert nothing == []
    findings = {finding.check: finding for finding in offers.plugins(Scope(registry))}
    assert findings["plugins"].status == "ok"
    assert f"{len(registry.records) - 2} of {len(registry.records)} work" in findings["plugins"].detail
    named = findings["plugin: broken_for_doctor"]
    assert named.status == "warning"
    assert "ModuleNotFoundError: No module named 'no_such_module_at_all'" in named.detail
    assert str(broken) in named.detail
    assert "no such file" in findings["plugin: missing"].detail
    assert {"coin", "kick-and-defend"} <= registry.games.keys()


def test_a_plugin_that_ends_the_program_is_as_broken_as_any(tmp_path: Path) -> None:
    (tmp_path / "leaves_at_once.py").write_text("raise SystemExit(0)\n")
    registry, nothing = find_plugins([tmp_path / "leaves_at_once.py"])
    assert nothing == []
    findings = {finding.check: finding for finding in offers.plugins(Scope(registry))}
    assert findings["plugin: leaves_at_once"].detail.startswith("SystemExit: 0 ")
    assert "kick-and-defend" in registry.games


def test_strict_plugins_make_a_broken_one_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("APIL_STRICT_PLUGINS", "1")
    registry, (finding,) = find_plugins([tmp_path / "missing.py"])
    assert not registry.records
    assert finding.status == "error"
    assert "'missing'" in finding.detail
    assert "APIL_STRICT_PLUGINS" in finding.remedy


def test_presets_are_valid_with_all_methods_and_not_without() -> None:
    (finding,) = offers.presets(Scope(discover()))
    assert finding.status == "ok"
    assert "paper" in finding.detail
    without = statuses(list(offers.presets(Scope(PluginRegistry()))))
    assert without["preset: paper"] == "warning"


# --- no check stops the others


def test_a_check_that_breaks_is_named_and_keeps_what_it_had_found() -> None:
    def breaks() -> Iterator[Finding]:
        yield Finding(check="half", status="ok", detail="done")
        raise OSError("disk\non fire")

    first, second = guarded("half", breaks)
    assert (first.status, second.status, second.check) == ("ok", "warning", "half")
    assert "this check itself failed: OSError: disk on fire" in second.detail


@pytest.mark.parametrize(
    ("game", "patience", "message"),
    [
        ("wild-killed", 100, "its process was ended by SIGKILL"),
        ("wild-asleep", 3, "no answer within 3 s"),
        ("wild-angry", 100, "RuntimeError: two lines"),
        ("wild-gone", 100, "its process ended with exit code 7: no message"),
    ],
)
def test_whatever_a_game_does_is_one_line(game: str, patience: float, message: str) -> None:
    with pytest.raises(TrialError) as caught:
        attempt("play", game, "0", plugin_files=[WILD], patience=patience)
    assert str(caught.value) == message


def test_files_of_the_user_are_not_taken_for_libraries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "numpy.py").write_text("raise ImportError('not me')\n")
    monkeypatch.chdir(tmp_path)
    assert attempt("play", "toy-pursuit", "0")["rate"] > 0


@pytest.mark.parametrize(
    ("statuses", "worst"), [("", "ok"), ("ok warning", "warning"), ("error ok", "error")]
)
def test_a_report_is_as_bad_as_its_worst_line(statuses: str, worst: str) -> None:
    findings = [Finding(check="x", status=status, detail="") for status in statuses.split()]  # type: ignore[arg-type]
    report = Report(version="1", findings=findings)
    assert report.status == worst
    assert report.model_dump()["status"] == worst


# --- games


def only(default: str, *files: Path, quick: bool = False) -> Scope:
    """A scope of the games and policies of one-file plugins alone."""
    everything, builtin = discover(files), discover()
    some = {name: spec for name, spec in everything.games.items() if name not in builtin.games}
    families = {name: spec for name, spec in builtin.games.items() if spec.family}
    registry = PluginRegistry(games={**families, **some}, policies=everything.policies)
    return Scope(registry, files, quick, default)


def test_a_game_of_others_is_measured_and_families_are_not() -> None:
    scope = only("coin", COIN)
    assert any(spec.family for spec in scope.plugins.games.values())
    (finding,) = offers.games(scope)
    assert (finding.check, finding.status) == ("game: coin", "ok")
    assert "steps/s with 64 games at once" in finding.detail


@pytest.mark.slow
def test_only_the_default_game_is_worth_an_error() -> None:
    found = statuses(list(offers.games(only("wild-gone", WILD, quick=True))))
    assert found == {"game: wild-gone": "error"}
    scope = only("coin", COIN, WILD)
    del scope.plugins.games["wild-asleep"]
    assert statuses(list(offers.games(scope))) == {
        "game: coin": "ok",
        "game: wild-killed": "warning",
        "game: wild-angry": "warning",
        "game: wild-gone": "warning",
    }


def test_a_default_game_that_nobody_offers_is_an_error() -> None:
    (finding,) = offers.games(Scope(PluginRegistry()))
    assert finding.status == "error"
    assert "'kick-and-defend'" in finding.detail


def test_a_wrong_opengl_setting_is_an_error_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    (finding,) = offers.games(Scope(discover(), quick=True))
    assert (finding.check, finding.status) == ("game: kick-and-defend", "error")
    assert "MUJOCO_GL" in finding.detail
    assert finding.remedy == "unset MUJOCO_GL, or set it to egl, osmesa or glfw"


# --- victims


def test_missing_weights_are_counted_with_the_commands_that_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("APIL_CACHE", str(tmp_path / "cache"))
    findings = {finding.check: finding for finding in offers.victims(Scope(discover()))}
    kickers = sum(entry.game == "kick-and-defend" for entry in catalogue.entries().values())
    kick = findings["victims: kick-and-defend"]
    assert f"zoo 0 of {kickers}" in kick.detail
    assert "`apil victims import DIR`" in kick.remedy
    assert "`apil victims download`" in kick.remedy
    toy = findings["victims: toy-pursuit"]
    assert (toy.status, toy.remedy) == ("ok", "")
    assert "scripted:toy-pursuit/evader/v1" in toy.detail
    assert not (tmp_path / "cache").exists()


def test_what_does_not_load_is_named_and_stops_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("APIL_CACHE", str(tmp_path))
    file = cache.cached_file(catalogue.entries()["kick-and-defend/kicker/v1"])
    file.parent.mkdir(parents=True)
    file.write_bytes(b"not weights")
    scope = Scope(discover((COIN, WILD)), (COIN, WILD))
    findings = {finding.check: finding for finding in offers.victims(scope)}
    damaged = findings["victim: zoo:kick-and-defend/kicker/v1"]
    assert damaged.status == "warning"
    assert f"{file} is damaged" in damaged.detail
    assert findings["victims: kick-and-defend"].status == "error"  # that is whom a run would attack
    assert findings["victims: sumo-ants"].status != "error"
    # of others
    assert findings["victim: wild:angry/side/v1"].detail == "wild:angry/side/v1 is torn"
    assert findings["victim: wild:gone/side/v1"].detail == "ZeroDivisionError: gone/side/v1"
    assert findings["victims: wild-angry"].status == "warning"
    assert findings["victims: coin"].status == "ok"

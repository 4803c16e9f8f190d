"""Every mistake is one line that says where, what, and what was probably meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from apil_core.common.errors import ConfigError, UnknownNameError
from apil_core.config.resolve import load_resolved, resolve
from apil_core.plugins.discovery import PluginRegistry


def message(registry: PluginRegistry, *sets: str, file: Path | None = None, **flags: object) -> str:
    with pytest.raises(ConfigError) as caught:
        resolve(file, sets=sets, flags=flags, plugins=registry)
    return str(caught.value)


FILE = """\
method: adrl
stepss: 5
ppo:
  epochs: 0
  learning_rte: 1
  hidden: [64, a]
learning_rate: 3
options:
  apl:
    advantage_difference: true
  apill: {}
victim_actions: sampel
recorders:
  - jsonl
  - wandbb
game:
  margn: 1
"""


def test_every_mistake_in_a_file_is_reported_with_its_line(registry: PluginRegistry, tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text(FILE)
    assert message(registry, file=file).splitlines() == [
        f"{file}:2: stepss: unknown key (did you mean 'steps'?)",
        f"{file}:4: ppo.epochs: should be greater than 0, got 0",
        f"{file}:5: ppo.learning_rte: unknown key (did you mean 'learning_rate'?)",
        f"{file}:6: ppo.hidden.1: should be a whole number, got 'a'",
        f"{file}:7: learning_rate: unknown key (did you mean 'ppo.learning_rate'?)",
        f"{file}:9: options.apl: method 'adrl' does not use 'apl' (option sections it reads: none)",
        f"{file}:11: options.apill: unknown method or observer 'apill' "
        "(did you mean 'apil'? known: adrl, apil, apl, e_apil)",
        f"{file}:12: victim_actions: should be 'sample' or 'mode', got 'sampel' (did you mean 'sample'?)",
        f"{file}:15: recorders.1: unknown recorder 'wandbb' (known: jsonl, tensorboard)",
        f"{file}:17: game.margn: unknown key (did you mean 'margin'?)",
    ]


@pytest.mark.parametrize(
    ("assignment", "rest"),
    [
        ("ppo.epochs=0", "should be greater than 0, got 0"),
        ("ppo.epoch=1", "unknown key (did you mean 'epochs'?)"),
        ("ppo=3", "should be a section of keys and values, got 3"),
        ("ppo={epochs: 0}", "ppo.epochs: should be greater than 0, got 0"),
        ("steps", "expected key=value, e.g. ppo.epochs=8"),
        ("a..b=1", "expected key=value, e.g. ppo.epochs=8"),
        ("ppo.hidden=[1", "the value is not YAML: expected ',' or ']', but got '<stream end>'"),
        ("options.apil.observes=vctim", "should be 'victim', 'adversary' or 'both', got 'vctim'"),
        ("options.apil.imitator.kll=1", "unknown key (did you mean 'kl'?)"),
        ("options.adrl.x=1", "options.adrl: method 'e_apil' does not use 'adrl'"),
        (
            "method=e_apill",
            "unknown method 'e_apill' (did you mean 'e_apil'? known: adrl, apil, apl, e_apil)",
        ),
        ("env=kick-and-defent", "unknown game 'kick-and-defent' (did you mean 'kick-and-defend'?"),
        ("device=gpu", "unknown device 'gpu' (did you mean 'cpu'? known: cpu, cuda, cuda:N)"),
        ("observers=[nobody]", "observers.0: unknown observer 'nobody'"),
        ("version=2", "is 2, newer than this apil understands (1): upgrade apil"),
        ("ppo.minibatches=99999", "num_envs × ppo.num_steps (16384) must hold at least two samples"),
    ],
)
def test_a_wrong_set_is_quoted(registry: PluginRegistry, assignment: str, rest: str) -> None:
    text = message(registry, assignment)
    assert text.startswith(f"--set {assignment}: {rest}")
    assert "\n" not in text


def test_a_wrong_flag_is_quoted(registry: PluginRegistry) -> None:
    assert message(registry, num_envs=0) == "--num-envs 0: should be greater than 0, got 0"


def test_a_method_without_options_takes_none(registry: PluginRegistry) -> None:
    expected = "--set options.adrl.x=1: options.adrl: method 'adrl' has no options"
    assert message(registry, "options.adrl.x=1", method="adrl") == expected


def test_the_last_layer_that_set_a_key_is_blamed(registry: PluginRegistry, tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text("ppo:\n  hidden: [64, a]\n  epochs: 0\n")
    expected = "--set ppo.hidden=[b]: ppo.hidden.0: should be a whole number"
    assert message(registry, "ppo.hidden=[b]", "ppo.epochs=1", file=file).startswith(expected)


def test_a_newer_version_hides_errors_that_would_mislead(registry: PluginRegistry, tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text("future_key: 1\nversion: 7\n")
    expected = f"{file}:2: version: is 7, newer than this apil understands (1): upgrade apil"
    assert message(registry, file=file) == expected
    with pytest.raises(ConfigError, match="newer than this apil"):
        load_resolved(file)


@pytest.mark.parametrize(
    ("text", "rest"),
    [
        ("a: [1\nb: 2\n", ":2: expected ',' or ']', but got ':'"),
        ("seed: 1\nseed: 2\n", ':2: found duplicate key "seed"'),
        ("- a\n", ":1: expected keys and values, got list"),
        ("a: !!python/object:os.system 1\n", ":1: a tag (!…) is no setting"),
    ],
)
def test_what_is_no_config_file(registry: PluginRegistry, tmp_path: Path, text: str, rest: str) -> None:
    file = tmp_path / "run.yaml"
    file.write_text(text)
    assert message(registry, file=file).startswith(f"{file}{rest}")


def test_a_missing_file_is_named(registry: PluginRegistry, tmp_path: Path) -> None:
    assert message(registry, file=tmp_path / "x.yaml") == f"{tmp_path / 'x.yaml'}: no such file"


def test_an_unknown_preset_is_suggested(registry: PluginRegistry) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown preset 'papper' \(did you mean 'paper'\?"):
        resolve(presets=["papper"], plugins=registry)


def test_a_damaged_stored_config_names_file_and_line(tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text("method: apil\nsteps: many\n")
    with pytest.raises(ConfigError, match=f"^{file}:2: steps: should be a whole number"):
        load_resolved(file)

"""Layers, presets and the complete config they give."""

from __future__ import annotations

from pathlib import Path

import pytest

from apil_core.api.config import RunConfig
from apil_core.config.layers import preset_names
from apil_core.config.resolve import differences, dump_yaml, load_resolved, resolve
from apil_core.config.schema import json_schema
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import default_plugins


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_nothing_given_gives_the_defaults_with_the_games_own_values_spelt_out(
    registry: PluginRegistry,
) -> None:
    config = resolve(plugins=registry)
    assert (config.method, config.steps, config.ppo) == ("e_apil", 35_000_000, RunConfig().ppo)
    assert (config.victim, config.victim_side) == ("zoo:kick-and-defend/kicker/v1", 0)
    assert (config.reward.dense_weight, config.reward.sparse_weight, config.reward.anneal_fraction) == (
        0.1,
        0.01,
        0.0,
    )
    assert config.game == {"margin": 0.5}
    assert set(config.options) == {"apl", "apil", "e_apil"}
    assert config.options["apil"]["imitator"]["update"] == "ppo"


def test_each_layer_covers_the_one_below(registry: PluginRegistry, tmp_path: Path) -> None:
    file = write(tmp_path / "a.yaml", "steps: 20\nnum_envs: 20\nseed: 20\nppo:\n  epochs: 20\n")
    config = resolve(
        file,
        ["apil-code"],
        ["seed=40", "ppo.gamma=0.5"],
        {"num_envs": 30, "seed": 30, "threads": None},
        plugins=registry,
    )
    assert config.ppo.minibatches == 128  # preset
    assert (config.steps, config.ppo.epochs) == (20, 20)  # file over default and preset
    assert config.num_envs == 30  # flag over file
    assert config.seed == 40  # --set over flag
    assert config.ppo.gamma == 0.5
    assert config.threads == 0  # None: not given


def test_presets_that_a_file_names_lie_below_it_and_below_preset_flags(
    registry: PluginRegistry, tmp_path: Path
) -> None:
    file = write(tmp_path / "a.yaml", "presets: [apil-code, quick]\nppo:\n  epochs: 20\n")
    config = resolve(file, plugins=registry)
    assert (config.ppo.minibatches, config.steps, config.ppo.epochs) == (128, 300_000, 20)
    assert (
        resolve(file, ["paper"], plugins=registry).steps == resolve(presets=["paper"], plugins=registry).steps
    )
    one = write(tmp_path / "b.yaml", "presets: quick\n")
    assert resolve(one, plugins=registry) == resolve(presets=["quick"], plugins=registry)


@pytest.mark.parametrize(
    ("text", "steps"),
    [("35M", 35_000_000), ("1.5k", 1500), ("1e6", 1_000_000), ("9007199254740993", 2**53 + 1)],
)
def test_whole_numbers_have_their_short_forms_in_files(
    registry: PluginRegistry, tmp_path: Path, text: str, steps: int
) -> None:
    file = write(tmp_path / "a.yaml", f"steps: {text}\nreward:\n  anneal_budget: '{text}'\nvictim: 35M\n")
    config = resolve(file, sets=[f"evaluation.every_steps={text}"], plugins=registry)
    assert (config.steps, config.reward.anneal_budget, config.evaluation.every_steps) == (steps, steps, steps)
    assert config.victim == "35M"


def test_set_values_are_yaml_and_the_last_one_wins(registry: PluginRegistry) -> None:
    sets = ["ppo.hidden=[8, 4]", "ppo.learning_rate=1e-3", "seed=1", "seed=2", "victim_side=null"]
    config = resolve(sets=[*sets, "evaluation={episodes: 7}"], plugins=registry)
    assert config.ppo.hidden == (8, 4)
    assert (config.ppo.learning_rate, config.seed, config.evaluation.episodes) == (1e-3, 2, 7)


def test_an_empty_section_changes_nothing(registry: PluginRegistry, tmp_path: Path) -> None:
    file = write(tmp_path / "a.yaml", "ppo:\noptions:\n  apil:\n")
    assert resolve(file, plugins=registry) == resolve(plugins=registry)


def test_the_games_values_yield_to_given_ones(registry: PluginRegistry) -> None:
    config = resolve(sets=["reward.dense_weight=0", "victim=zoo:x"], plugins=registry)
    assert (config.reward.dense_weight, config.reward.sparse_weight, config.victim) == (0.0, 0.01, "zoo:x")


def test_the_other_side_has_no_default_victim(registry: PluginRegistry) -> None:
    assert resolve(sets=["victim_side=1"], plugins=registry).victim == "auto"


def test_paths_in_a_file_are_relative_to_it(registry: PluginRegistry, tmp_path: Path) -> None:
    file = write(tmp_path / "a.yaml", "init_from: old\nplugins: [p.py]\n")
    config = resolve(file, plugins=registry)
    assert (config.init_from, config.plugins) == (str(tmp_path / "old"), (str(tmp_path / "p.py"),))


def test_a_run_directory_serves_as_file(registry: PluginRegistry, tmp_path: Path) -> None:
    config = resolve(sets=["seed=5"], plugins=registry)
    write(tmp_path / "config.yaml", dump_yaml(config))
    assert resolve(tmp_path, plugins=registry) == config


@pytest.mark.parametrize("preset", preset_names())
@pytest.mark.parametrize("method", ["adrl", "apl", "apil", "e_apil", None])
def test_every_preset_is_valid_for_every_method(preset: str, method: str | None) -> None:
    registry = default_plugins()
    config = resolve(presets=[preset], flags={"method": method}, plugins=registry)
    assert set(config.options) == {spec.name for spec in registry.method_chain(config.method) if spec.config}


def test_the_paper_preset_is_the_defaults_but_for_the_imitator(registry: PluginRegistry) -> None:
    published = differences(resolve(presets=["paper"], plugins=registry), resolve(plugins=registry))
    assert published == {
        "options.apil.imitator.credit": ("return", None),
        "options.apil.imitator.update": ("trpo", "ppo"),
        "options.apil.imitator.value_epochs": (4, 1),
        "options.apil.imitator.learning_rate": (3e-4, 6e-4),
        "options.apil.imitator.epochs": (4, 2),
        "options.apil.imitator.minibatches": (4, 32),
        "options.apil.discriminator.epochs": (None, 2),
        "options.apil.discriminator.minibatches": (None, 32),
        "options.apil.discriminator.gradient_penalty": (0.0, 0.3),
    }


def test_the_published_imitator_is_paid_for_the_return_and_d_steps_with_ppo(registry: PluginRegistry) -> None:
    for preset in ("paper", "apil-code"):
        apil = resolve(presets=[preset], plugins=registry).options["apil"]
        assert apil["imitator"]["credit"] == "return"
        assert apil["discriminator"]["epochs"] is apil["discriminator"]["minibatches"] is None


def test_code_presets_have_the_published_action_modes_and_batches(registry: PluginRegistry) -> None:
    expected = {
        "adrl-code": ("adrl", "mode", "sample", 8 * 2048, "constant", 0.5),
        "apl-code": ("apl", "mode", "sample", 8 * 2048, "linear", 0.2),
        "apil-code": ("apil", "sample", "mode", 32 * 2048, "constant", 0.5),
    }
    for name, facts in expected.items():
        config = resolve(presets=[name], plugins=registry)
        ppo = config.ppo
        assert facts == (
            config.method,
            config.victim_actions,
            config.evaluation.victim_actions,
            config.num_envs * ppo.num_steps,
            ppo.lr_schedule,
            ppo.value_coefficient,
        )


def test_the_apil_code_preset_takes_the_codes_side_everywhere(registry: PluginRegistry) -> None:
    config = resolve(presets=["apil-code"], flags={"method": "e_apil"}, plugins=registry)
    options = config.options["apil"]
    assert (options["reward"], options["reward_time"], options["observes"]) == (
        "neg_log_1md",
        "collected",
        "both",
    )
    assert options["share_victim_observation"] is True
    assert (options["imitator"]["update"], options["discriminator"]["state"]) == ("ppo", "next")
    assert (config.ppo.optimizer, config.num_envs * config.ppo.num_steps // config.ppo.minibatches) == (
        "adamw",
        512,
    )


def test_a_stored_config_reads_back_equal(found: PluginRegistry, tmp_path: Path) -> None:
    config = resolve(presets=["apil-code"], sets=["ppo.learning_rate=1e-5", "seed=3"], plugins=found)
    for text in (dump_yaml(config), dump_yaml(config, found)):
        assert load_resolved(write(tmp_path / "config.yaml", text)) == config


def test_stored_yaml_explains_its_keys(registry: PluginRegistry) -> None:
    lines = dump_yaml(resolve(plugins=registry), registry).splitlines()
    for key, comment in {
        "  epochs: 4": "  # Passes over each rollout.",
        "init_from: null": "# Run directory to initialise from, or policy (zoo:…, run:…) to clone first.",
        "    observes: victim": "    # Observation that the imitator and D read.",
        "  margin: 0.5": "  # How much larger a sum must be to win.",
    }.items():
        assert lines[lines.index(key) - 1] == comment


def test_differences_name_dotted_keys(registry: PluginRegistry) -> None:
    first = resolve(flags={"method": "adrl"}, plugins=registry)
    second = resolve(flags={"method": "apl", "seed": 1}, plugins=registry)
    assert differences(first, second) == {
        "method": ("adrl", "apl"),
        "seed": (0, 1),
        "options": ({}, None),
        "options.apl.advantage_difference": (None, False),
    }


def test_the_schema_describes_core_and_method_options(registry: PluginRegistry) -> None:
    schema = json_schema(registry, "apil")
    assert schema["properties"]["method"]["enum"] == ["apil"]
    assert "kick-and-defend" in schema["properties"]["env"]["enum"]
    options = schema["$defs"]["MethodOptions"]["properties"]
    assert set(options) == {"apl", "apil"}
    assert schema["$defs"]["ApilConfig"]["properties"]["observes"]["enum"] == ["victim", "adversary", "both"]
    assert schema["additionalProperties"] is False
    assert "required" not in schema
    assert set(json_schema(registry)["$defs"]["MethodOptions"]["properties"]) == {"apl", "apil", "e_apil"}

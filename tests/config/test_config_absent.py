"""A stored config that lacks keys added since means what their absence meant when it was stored."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import pytest
from helpers.small_runs import small_config

from apil_core import (
    ApilError,
    ConfigError,
    RunConfig,
    RunDirError,
    Section,
    absent,
    evaluate,
    resume,
    run,
    trust,
)
from apil_core.config.absent import filled, with_absent
from apil_core.config.layers import parse_yaml
from apil_core.config.resolve import dump_yaml, flatten, load_resolved, resolve
from apil_core.plugins.registry import default_plugins
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir

ROOT = Path(__file__).parents[2]
LONG = ROOT / "docs" / "results" / "long" / "kick-and-defend" / "e_apil" / "s0"

ADDED = {
    "init_steps": 200_000,
    "evaluation.stop_when.win_rate_above": None,
    "evaluation.stop_when.no_gain_in": None,
    "reward.anneal_budget": None,
    "ppo.action_unit": "game",
    "ppo.critic_observes": "own",
    "ppo.clip_value": True,
    "ppo.max_kl": None,
    "ppo.noise": "white",
    "ppo.noise_correlation": 0.8,
    "ppo.noise_colour": 0.5,
    "options.apil.imitator.objective": "gail",
    "options.apil.imitator.credit": "return",
    "options.apil.imitator.likelihood_weight": 1.0,
    "options.apil.imitator.likelihood_floor": 0.1,
    "options.apil.imitator.likelihood_half_life": 500_000.0,
    "options.apil.discriminator.epochs": None,
    "options.apil.discriminator.minibatches": None,
    "options.apil.discriminator.gradient_penalty": 0.0,
}
"""Every key that is younger than the oldest run that is kept, and what that run did where the key now is.

Whoever adds a key adds it here. If a run without it did not do what the key's default says, mark the key
with ``apil_core.absent``.
"""


def test_keys_added_since_the_oldest_kept_run_mean_what_was_done_then():
    stored, _ = parse_yaml((LONG / "config.yaml").read_text(), "stored")
    before, now = flatten(stored), flatten(load_resolved(LONG / "config.yaml").model_dump(mode="json"))
    assert {key: value for key, value in now.items() if key not in before} == ADDED
    assert {key: now[key] for key in before} == before


def test_a_marked_key_differs_from_its_default():
    new = resolve(flags={"method": "e_apil"}, plugins=default_plugins()).options["apil"]
    assert new["imitator"]["credit"] is None
    assert new["discriminator"]["epochs"] is not None


def test_a_runs_own_config_is_a_stored_one_and_any_other_file_is_not(tmp_path):
    for own in (LONG, LONG / "config.yaml"):
        again = resolve(own, sets=["steps=9"], plugins=default_plugins())
        assert again.options["apil"]["imitator"]["credit"] == "return"
    (tmp_path / "config.yaml").write_text("seed: 3\nmethod: apil\n")
    for mine in (tmp_path, tmp_path / "config.yaml"):
        new = resolve(mine, ["quick"], plugins=default_plugins())
        assert new.options["apil"]["imitator"]["credit"] is None
        assert (new.seed, new.steps) == (3, 300_000)  # what it lacks hides no preset
    whole = tmp_path / "whole.yaml"
    whole.write_text(dump_yaml(RunConfig(method="apil")))
    assert resolve(whole, plugins=default_plugins()).options["apil"]["imitator"]["credit"] is None


def test_today_the_paper_preset_is_the_old_default():
    """So that benchmarks begun with it go on."""
    now = resolve(presets=["paper"], flags={"method": "e_apil"}, plugins=default_plugins())
    assert now.options == load_resolved(LONG / "config.yaml").options


OLD_PLUGIN = """
from typing import Annotated
from apil_core import Method, MethodSpec, Section, absent, hookimpl

class Options(Section):
    kept: int = 1
{added}
class Made(Method):
    @hookimpl
    def shape_reward(self, step):
        return {{"offset": 0 * step.reward + getattr(self.options, "size", -1.0)}}

@hookimpl
def register_methods():
    return [MethodSpec("aged", f"{{__name__}}:Made", config=f"{{__name__}}:Options")]
"""


def aged(tmp_path, name, added=""):
    file = tmp_path / f"{name}.py"
    file.write_text(OLD_PLUGIN.format(added=added))
    return str(file)


def change(file, before, after):
    assert before in file.read_text()
    file.write_text(file.read_text().replace(before, after))


def test_a_plugins_new_key_means_what_its_author_says(tmp_path):
    """A one-file plugin's too: trained before the key existed, then resumed and evaluated with it."""
    config = small_config("aged", plugins=(aged(tmp_path, "before"),), steps=512)
    run(config, out=tmp_path / "r")
    aged(tmp_path, "after", "    size: Annotated[float, absent(-1.0)] = 7.0\n")
    change(tmp_path / "r" / "config.yaml", "before.py", "after.py")  # a process loads a file once
    trust(str(tmp_path / "after.py"))
    evaluate(tmp_path / "r", episodes=5)
    resume(tmp_path / "r", steps=1024)
    assert RunDir(tmp_path / "r").config().options["aged"] == {"kept": 1, "size": -1.0}
    assert RunDir(tmp_path / "r").last_metrics()["reward/offset"] == -1.0
    change(tmp_path / "r" / "config.yaml", "size: -1.0", "size: 2.0")
    with pytest.raises(RunDirError, match="size"):  # what does differ is still told
        evaluate(tmp_path / "r", episodes=5)


def test_a_core_key_that_a_checkpoint_lacks_is_no_difference(tmp_path):
    run(small_config("e_apil", steps=512), out=tmp_path / "r")
    path = RunDir(tmp_path / "r").newest_checkpoint()
    state = checkpoint.read(path)
    for section in (state["config"]["ppo"], state["config"]["evaluation"]):
        section.popitem()
    del state["config"]["options"]["apil"]["imitator"]["likelihood_floor"]
    checkpoint.save(path, state)
    evaluate(tmp_path / "r", episodes=5)
    resume(tmp_path / "r", steps=1024)


def odd(config, **changes):
    return {**config, **changes}


@pytest.mark.parametrize(
    "change",
    [
        lambda config: odd(config, ppo={**config["ppo"], "newer": 1}),
        lambda config: odd(config, ppo={**config["ppo"], "epochs": -1}),
        lambda config: odd(config, options=[1]),
        lambda config: odd(config, ppo=3),
        lambda config: None,
        lambda config: [config],
    ],
)
def test_an_odd_config_in_a_checkpoint_is_one_line(tmp_path, change):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    path = RunDir(tmp_path / "r").newest_checkpoint()
    state = checkpoint.read(path)
    checkpoint.save(path, {**state, "config": change(state["config"])})
    with suppress(ApilError):  # it compares less, so it may not mind
        evaluate(tmp_path / "r", episodes=5)
    with pytest.raises(RunDirError, match="is of another run or configuration"):
        resume(tmp_path / "r", steps=1024)


@pytest.mark.parametrize("options", ["[1]", "abc", "{apil: 3}"])
def test_odd_options_in_a_runs_config_are_one_line(tmp_path, options):
    text = (LONG / "config.yaml").read_text()
    (tmp_path / "config.yaml").write_text(text[: text.index("\noptions:")] + f"\noptions: {options}\n")
    shutil.copy(LONG / "environment.json", tmp_path)
    with pytest.raises(ConfigError, match="options"):
        resolve(tmp_path / "config.yaml", plugins=default_plugins())


def test_wrong_values_are_still_told_with_their_line(tmp_path):
    text = (LONG / "config.yaml").read_text().replace("  epochs: 4", "  epochs: 0")
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"config.yaml:\d+: ppo.epochs"):
        load_resolved(tmp_path / "config.yaml")


def test_what_is_not_installed_leaves_the_rest_complete():
    stored, _ = parse_yaml((LONG / "config.yaml").read_text(), "stored")
    unknown = with_absent({**stored, "env": "gone"}, default_plugins())
    assert unknown["options"]["apil"]["imitator"]["credit"] == "return"
    assert with_absent({**stored, "method": "gone"}, default_plugins())["options"] == stored["options"]


class Inner(Section):
    old: int = 1
    new: Annotated[int, absent(0)] = 2


class Outer(Section):
    plain: Inner = Inner()
    stated: Inner = Inner(new=7)
    optional: Inner | None = None
    marked: Annotated[Inner, absent({"old": 5})] = Inner()


def test_sections_optional_ones_and_defaults_of_their_own():
    complete = filled({"optional": {"old": 3}}, Outer)
    assert complete == {
        "plain": {"old": 1, "new": 0},
        "stated": {"old": 1, "new": 7},
        "optional": {"old": 3, "new": 0},
        "marked": {"old": 5, "new": 0},
    }


def test_nested_models_are_filled_inside():
    from apil_apil.config import ApilConfig

    complete = filled({"imitator": {"update": "ppo"}}, ApilConfig)
    assert complete["imitator"]["update"] == "ppo"
    assert complete["imitator"]["credit"] == "return"
    assert complete["prediction"] == "imitator"

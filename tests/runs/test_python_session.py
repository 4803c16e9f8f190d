"""Configurations, methods, callbacks and policies made in Python."""

from __future__ import annotations

import pytest
import torch

from apil_core import (
    ApilError,
    Callback,
    Method,
    MethodSpec,
    RunConfig,
    Section,
    crossplay,
    define,
    evaluate,
    hookimpl,
    load_policy,
    load_run,
    resume,
    run,
)
from apil_core.plugins import defined

QUICK = {"env": "toy-pursuit", "steps": 2 * 16 * 32, "num_envs": 16, "evaluation": {"episodes": 20}}
PPO = {"num_steps": 32, "minibatches": 1, "epochs": 1}


def quick(**settings):
    return RunConfig.load(**{"method": "adrl", **QUICK, "ppo": PPO, **settings})


class SlowOptions(Section):
    """Options."""

    weight: float = 0.5
    """Of the term."""


class Slow(Method):
    """Reward small actions of the victim."""

    @hookimpl
    def shape_reward(self, run, step):
        weight = 1.0 if self.options is None else self.options.weight
        return {"slow": -weight * step.victim_action.square().mean(-1)}


class Watch(Callback):
    """Counts iterations, and stops after the first."""

    def __init__(self):
        self.steps = []

    def iteration_finished(self, run, metrics):
        self.steps.append(metrics["steps"])
        run.stop("seen enough")


class Bonus(Callback):
    """Adds a constant, counted over restarts."""

    def __init__(self):
        self.calls = 0

    def shape_reward(self, run, step):
        self.calls += 1
        return {"bonus": torch.ones(len(step.done))}

    def state_dict(self):
        return {"calls": self.calls}

    def load_state_dict(self, state):
        self.calls = state["calls"]


class TestConfig:
    def test_presets_files_and_keywords_lie_over_each_other(self, tmp_path):
        file = tmp_path / "my.yaml"
        file.write_text("method: apl\nenv: toy-pursuit\nppo: {gamma: 0.9, lam: 0.5}\n")
        config = RunConfig.load(file, presets=["efficient"], ppo={"gamma": 0.8}, **{"ppo.epochs": 3})
        assert (config.method, config.ppo.noise) == ("apl", "coloured")
        assert (config.ppo.gamma, config.ppo.lam, config.ppo.epochs) == (0.8, 0.5, 3)
        assert RunConfig.load("paper").victim_actions == "sample"

    def test_physics_is_the_profile(self):
        assert RunConfig.load(physics="fast").game["physics"] == "fast"

    @pytest.mark.parametrize(
        ("settings", "says"),
        [
            ({"ppo": {"gama": 0.9}}, "RunConfig.load: ppo.gama: unknown key (did you mean 'gamma'?)"),
            ({"method": "adrll"}, "unknown method 'adrll' (did you mean 'adrl'?"),
            ({"physics": "fastt", "env": "sumo-ants"}, "fastt"),
        ],
    )
    def test_a_mistake_is_one_line(self, settings, says):
        with pytest.raises(ApilError) as error:
            RunConfig.load(**settings)
        assert says in str(error.value)
        assert "\n" not in str(error.value)


class TestMethods:
    def test_a_class_is_trained_resumed_and_scored(self, tmp_path):
        result = run(quick(method=Slow), out=tmp_path / "a")
        run_ = load_run(result)
        assert run_.config.method == "slow"
        assert (run_.metrics["reward/slow"] < 0).all()
        assert resume(result, steps=3 * 16 * 32).steps == 3 * 16 * 32
        assert evaluate(result, episodes=5).episodes == 5

    def test_run_takes_classes_and_specs_with_options_and_requirements(self, tmp_path):
        spec = MethodSpec("slower", Slow, requires=("apl",), config=SlowOptions)
        config = quick().model_copy(update={"options": {}})
        result = run(config, methods=[spec], out=tmp_path / "a")
        stored = load_run(result).config
        assert (stored.method, stored.options["slower"]) == ("slower", {"weight": 0.5})

    def test_where_the_class_is_absent_one_line_names_it(self, tmp_path):
        run(quick(method=Slow), out=tmp_path / "a")
        defined.defined.clear()
        for use in (lambda: resume(tmp_path / "a", steps=9000), lambda: evaluate(tmp_path / "a")):
            with pytest.raises(
                ApilError, match=r"the run's method 'slow' is not known here .*define"
            ) as error:
                use()
            assert "\n" not in str(error.value)
        assert resume(tmp_path / "a", steps=3 * 16 * 32, methods=[Slow]).status == "finished"

    def test_defining_again_replaces_but_never_an_installed_method(self):
        assert define(Slow) == ("slow",)
        other = MethodSpec("slow", Slow, "another")
        define(other)
        assert RunConfig.load(method="slow", env="toy-pursuit").method == "slow"
        with pytest.raises(ApilError, match="'apl'"):
            define(MethodSpec("apl", Slow))
        assert list(defined.defined) == ["slow"]
        with pytest.raises(ApilError, match="neither a class"):
            define(dict)


class TestCallbacks:
    def test_one_that_watches_stops_the_run_and_leaves_no_trace(self, tmp_path):
        watch = Watch()
        result = run(quick(), callbacks=[watch], out=tmp_path / "a")
        assert (result.steps, result.stopped, watch.steps) == (512, "seen enough", [512])
        assert load_run(result).config.observers == ()
        assert resume(result, steps=1024).steps == 1024

    def test_one_that_takes_part_is_stored_with_its_state(self, tmp_path):
        result = run(quick(), callbacks=[Bonus()], out=tmp_path / "a")
        assert load_run(result).config.observers == ("Bonus",)
        defined.defined.clear()
        with pytest.raises(ApilError, match="the run's observer 'Bonus' is not known here"):
            resume(result, steps=2048)
        again = Bonus()
        resume(result, steps=3 * 512, callbacks=[again])
        assert again.calls == 3 * 32
        assert evaluate(result, episodes=5).episodes == 5

    def test_wrong_ones_are_refused(self, tmp_path):
        class Wrong(Callback):
            def iteration_finished(self, run, metrics, colour):
                pass

        with pytest.raises(ApilError, match="Wrong: iteration_finished takes 'colour'"):
            run(quick(), callbacks=[Wrong()], out=tmp_path / "a")
        with pytest.raises(ApilError, match="two are named Watch"):
            run(quick(), callbacks=[Watch(), Watch()], out=tmp_path / "b")
        assert not list(tmp_path.iterdir())


class TestObjects:
    def test_a_policy_object_plays_like_its_name(self):
        name = "scripted:toy-pursuit/evader/v1"
        settings = {"env": "toy-pursuit", "episodes": 30}
        by_name = evaluate("random", victim=name, **settings)
        victim = load_policy(name)
        by_object = evaluate("random", victim=victim, **settings)
        assert (by_object.wins, by_object.victim.sha256) == (by_name.wins, by_name.victim.sha256)
        assert by_object.victim.name.startswith("object:")
        table = crossplay({"r": "random"}, {"v": victim}, env="toy-pursuit", episodes=30)
        assert table.score("r", "v").wins == by_name.wins

    def test_an_object_of_an_ended_session_is_named(self):
        with pytest.raises(ApilError, match="object:Evader-9 was an object of the Python session"):
            evaluate("random", victim="object:Evader-9", env="toy-pursuit")


class TestLoadedRun:
    def test_frames_and_pictures(self, tmp_path):
        pytest.importorskip("pandas")
        config = quick(
            steps=20 * 512, **{"evaluation.every_steps": 10 * 512, "evaluation.periodic_episodes": 40}
        )
        loaded = load_run(run(config, out=tmp_path / "a"))
        assert list(loaded.metrics.index) == [512 * i for i in range(1, 21)]
        assert list(loaded.scores["name"]) == ["during training", "during training", "final"]
        assert list(loaded.scores["games"]) == [40, 40, 20]
        assert loaded.plot("ppo/kl").data.startswith(b"\x89PNG")
        film = loaded.film(None)
        assert (film.kind, film.data[4:8]) == ("video/mp4", b"ftyp")
        assert "10,240 steps, finished" in repr(loaded)

    def test_no_run(self, tmp_path):
        with pytest.raises(ApilError, match="no run directory"):
            load_run(tmp_path)

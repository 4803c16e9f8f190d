"""Plugins broken in every way we could think of, by their row in docs/broken-plugins.md."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

RUN = ("run", "--plugin", "bad.py", "--method", "bad")
OBSERVED = ("run", "--plugin", "bad.py", "--method", "adrl", "--set", "observers=[bad]")
INNOCENT = ("run", "--plugin", "bad.py", "--method", "adrl")
CHECK = ("plugins", "--check", "--plugin", "bad.py")

HEAD = """\
import torch
from apil_core import Deprecation, Method, MethodSpec, hookimpl, hookspec

APIL_HOOK_API = 1

"""
STEPS_LATER = "run.iteration == 1"


@dataclass(frozen=True)
class Case:
    """One mistake.

    Attributes:
        source: of ``bad.py``.
        command: what the user types after ``apil``.
        code: exit code.
        file: the plugin's name, where it is not ``bad.py``.
        installed: the file is a package's module with an entry point of that name, not a one-file plugin.
    """

    source: str
    command: tuple[str, ...] = RUN
    code: int = 2
    file: str = "bad.py"
    installed: str = ""


def method(body: str, spec: str = "", before: str = "", **rest: object) -> Case:
    """A method ``bad`` with that class body, and further arguments of its ``MethodSpec``."""
    made = f"{HEAD}{textwrap.dedent(before)}\nclass Bad(Method):\n{_indented(body)}\n"
    offer = f'    return [MethodSpec("bad", f"{{__name__}}:Bad", {spec})]\n'
    return Case(f"{made}\n@hookimpl\ndef register_methods():\n{offer}", **rest)  # type: ignore[arg-type]


def hook(signature: str, *statements: str, mark: str = "hookimpl", **rest: object) -> Case:
    """A method ``bad`` that fills one hook."""
    name, _, arguments = signature.partition("(")
    lines = [f"@{mark}", f"def {name}(self, {arguments}:", *(f"    {line}" for line in statements)]
    return method("\n".join(lines), **rest)  # type: ignore[arg-type]


def offer(spec: str) -> Case:
    """A method ``bad`` with that specification and nothing else."""
    return Case(f"{HEAD}\n@hookimpl\ndef register_methods():\n    return [MethodSpec({spec})]\n")


def module(source: str, **rest: object) -> Case:
    """A file of that source, brought along by a run that does not use it."""
    return Case(HEAD + textwrap.dedent(source), command=INNOCENT, **rest)  # type: ignore[arg-type]


def observer(source: str, **rest: object) -> Case:
    """A file of that source, switched on as an observer of ADRL."""
    return Case(HEAD + textwrap.dedent(source), command=OBSERVED, **rest)  # type: ignore[arg-type]


def registered_observer(name: str, before: str = "") -> Case:
    """An observer of that name, switched on, whose class is ``Bad``."""
    made = f"{HEAD}from apil_core import Observer, ObserverSpec\n{before}\nclass Bad(Observer): pass\n"
    offer = f'    return [ObserverSpec("{name}", f"{{__name__}}:Bad")]\n'
    return Case(f"{made}\n@hookimpl\ndef register_observers():\n{offer}", command=OBSERVED)


def state(expression: str, load: str = "pass") -> Case:
    """A method ``bad`` with that state."""
    return method(
        f"def state_dict(self):\n    return {expression}\n\ndef load_state_dict(self, state):\n    {load}\n\n"
    )


def _indented(body: str) -> str:
    return textwrap.indent(textwrap.dedent(body).strip(), "    ") or "    pass"


DISCOVERY = {
    "imports what is not installed": Case("import nowhere", INNOCENT),
    "does not parse": Case("def", INNOCENT),
    "ends Python while it is imported": Case("import sys\nsys.exit(3)", INNOCENT),
    "there is no such file": Case("", ("run", "--plugin", "gone.py")),
    "is no Python file": Case("", ("run", "--plugin", "bad.txt"), file="bad.txt"),
    "has the name of a module": Case("", ("run", "--plugin", "json.py"), file="json.py"),
    "an installed one does not import": Case(
        "import nowhere", ("plugins", "--check"), code=1, installed="bad"
    ),
    "an installed one has another's name": Case("", ("plugins", "--check"), code=1, installed="apl"),
    "offers a method that exists": module(
        """
        @hookimpl
        def register_methods():
            return [MethodSpec("apl", "bad:Bad")]
        """
    ),
    "offers one name twice": offer('"bad", "bad:A"), MethodSpec("bad", "bad:B"'),
    "misspells `register_methods`": module("@hookimpl\ndef register_method(): return []"),
    "`register_methods` takes an argument": module("@hookimpl\ndef register_methods(plugins): return []"),
    "`register_methods` is not marked": module("def register_methods(): return []"),
    "`register_methods` fails": module("@hookimpl\ndef register_methods(): return [][0]"),
    "`register_methods` returns nothing": module("@hookimpl\ndef register_methods(): pass"),
    "`register_methods` returns names": module("@hookimpl\ndef register_methods(): return ['bad']"),
    "is built for a newer hook API": Case("APIL_HOOK_API = 3", INNOCENT),
    "is built for a newer one, imports what is new": Case(
        "APIL_HOOK_API = 3\nfrom apil_core import Invented", INNOCENT
    ),
    "is built for one no longer supported": Case("APIL_HOOK_API = 0", INNOCENT),
    "states no number": Case("APIL_HOOK_API = 'one'", INNOCENT),
}

BEFORE = {
    "requires a method that is not there": offer('"bad", "bad:Bad", requires=("gone",)'),
    "requires itself in a circle": offer(
        '"bad", "bad:A", requires=("worse",)), MethodSpec("worse", "bad:B", requires=("bad",)'
    ),
    "its factory's module is not there": offer('"bad", "gone:Bad"'),
    "its factory is not there": offer('"bad", "bad:Gone"'),
    "its factory gives no `Method`": method(
        "", before="class Method:\n    def __init__(self, options, setup): pass"
    ),
    "its class fails when it is built": method("def __init__(self, options, setup):\n    {}['rate']"),
    "its options' model is not there": method("", 'config="bad:Options"'),
    "its options' model is not pydantic's": method("", 'config="bad:Bad"'),
    "its `hookspecs` are not there": method("", 'hookspecs="gone"'),
    "its `hookspecs` hold no hook": method("", 'hookspecs="json"'),
    "misspells a run hook": hook("shape_rewards(run, step)", "return {}"),
    "takes an argument that a hook does not have": hook("shape_reward(run, steps)", "return {}"),
    "an observer's function takes `self`": observer("@hookimpl\ndef run_started(self, run): pass"),
    "fills a hook of a method it does not require": hook("imitation_reward(rollout)", "return None"),
    "a wrapper without `yield`": hook("shape_reward(step)", "return {}", mark="hookimpl(wrapper=True)"),
    "wraps `filter_observation`": hook("filter_observation(obs)", "yield", mark="hookimpl(wrapper=True)"),
    "is no observer, but named as one": Case("", ("run", "--set", "observers=[apll]")),
    "is a plugin without run hooks, but named as an observer": Case("", ("run", "--set", "observers=[apl]")),
    "an observer's factory gives no `Observer`": registered_observer(
        "bad", before="class Observer:\n    def __init__(self, options, setup): pass"
    ),
    "an observer has the name of a method": registered_observer("apil"),
    "`state_dict` holds a function": state('{"act": lambda: 0}'),
    "`state_dict` holds an open file": state('{"log": {"file": open("log.txt", "w")}}'),
    "`state_dict` holds an object of its own": state('{"parts": [Bad.__new__(Bad)]}'),
    "`state_dict` holds a numpy array": state('{"w": torch.ones(2).numpy()}'),
    "`state_dict` holds a tensor with its graph": state('{"w": torch.ones(2, requires_grad=True) * 2}'),
    "`state_dict` forgets to return": state("None"),
    "`state_dict` fails": state("self.net"),
    "state does not load back": state('{"w": torch.ones(2)}', 'self.w = state["weight"]'),
    "has a `state_dict` and no `load_state_dict`": method(
        "def state_dict(self): return {'w': torch.ones(2)}"
    ),
}

FIRST = {
    "`extend_observation`: wrong number of axes": hook(
        "extend_observation(view)", 'return {"g": view.own[:, 0]}'
    ),
    "`extend_observation`: wrong dtype": hook("extend_observation(view)", 'return {"g": view.own.double()}'),
    "`extend_observation`: too few rows": hook("extend_observation(view)", 'return {"g": view.own[:2]}'),
    "`extend_observation`: NaN": hook("extend_observation(view)", 'return {"g": view.own / 0 * 0}'),
    "`extend_observation`: name taken": hook("extend_observation(view)", 'return {"own": view.own}'),
    "`extend_observation`: impossible name": hook("extend_observation(view)", 'return {"a.b": view.own}'),
    "`filter_observation`: wrong shape": hook("filter_observation(obs)", "return obs[:, 1:]"),
    "`filter_observation`: no tensor": hook("filter_observation(obs)", 'return "blind"'),
    "`filter_observation`: a numpy array": hook("filter_observation(obs)", "return obs.numpy().copy()"),
    "`run_started` fails": hook("run_started(run)", "run.wins"),
    "`shape_reward`: wrong shape": hook("shape_reward(step)", 'return {"b": step.reward[:3]}'),
    "`shape_reward`: wrong dtype": hook("shape_reward(step)", 'return {"b": step.reward.double()}'),
    "`shape_reward`: a number": hook("shape_reward(step)", 'return {"b": 0.5}'),
    "`shape_reward`: no dict": hook("shape_reward(step)", "return step.reward"),
    "`shape_reward`: names are no strings": hook("shape_reward(step)", "return {1: step.reward}"),
    "`shape_reward`: NaN": hook("shape_reward(step)", 'return {"b": step.reward * float("nan")}'),
    "`shape_reward`: infinite": hook("shape_reward(step)", 'return {"b": step.reward + float("inf")}'),
    "`shape_reward`: on another device": hook("shape_reward(step)", 'return {"b": step.reward.to("meta")}'),
    "`shape_reward`: name taken": hook("shape_reward(step)", 'return {"victim": step.reward}'),
    "`shape_reward`: another plugin's name": hook(
        "shape_reward(step)", 'return {"minus_victim": step.reward}', spec='requires=("apl",)'
    ),
    "`shape_reward` fails": hook("shape_reward(step)", "return step.rewards"),
    "`shape_reward` forgets `self`": method(
        "@hookimpl\ndef shape_reward(step):\n    return {'b': step.reward}"
    ),
    "`relabel_reward`: wrong shape": hook("relabel_reward(reward)", "return reward[0]"),
    "`relabel_reward` is wrapped": hook("relabel_reward()", "return (yield)", mark="hookimpl(wrapper=True)"),
    "`finish_rollout`: wrong shape": hook("finish_rollout(rollout)", 'return {"s": rollout.reward[0]}'),
    "`finish_rollout`: name taken": hook("finish_rollout(rollout)", 'return {"reward": rollout.reward}'),
    "`combine_advantages`: wrong shape": hook("combine_advantages(streams)", 'return streams["reward"][0]'),
    "`combine_advantages`: all equal, divided by their spread": hook(
        "combine_advantages(streams)", 'return streams["reward"] / 0'
    ),
    "`update_auxiliary`: metric is no number": hook(
        "update_auxiliary(run)", 'return {"loss": torch.ones(2)}'
    ),
    "`update_auxiliary`: no dict": hook("update_auxiliary(run)", "return 0.5"),
    "changes a filtered observation in place": hook("filter_observation(obs)", "obs[:, 0] = 0", "return obs"),
    "changes a view in place": hook(
        "extend_observation(view)", "view.opponent.add_(1)", 'return {"o": view.opponent}'
    ),
    "changes a step in place": hook("shape_reward(step)", "step.reward.add_(1)", "return None"),
    "changes a rollout in place": hook("finish_rollout(rollout)", "rollout.reward.sub_(1)", "return None"),
    "changes advantages in place": hook(
        "combine_advantages(streams)", 'streams["reward"] -= 1', 'return streams["reward"]'
    ),
    "adds to what others are handed": hook(
        "update_auxiliary(rollout)", "rollout.groups['z'] = rollout.reward"
    ),
}

LATER = {
    "fails at step 1000": hook(
        "shape_reward(run, step)", "if run.steps >= 1000: raise RuntimeError('step 1000')", "return {}"
    ),
    "stops returning a reward stream": hook(
        "finish_rollout(run, rollout)", f'return None if {STEPS_LATER} else {{"s": rollout.reward}}'
    ),
    "an observation group changes its width": method(
        """
        calls = 0

        @hookimpl
        def extend_observation(self, view):
            self.calls += 1
            return {"g": view.own if self.calls < 12 else view.own[:, 1:]}
        """
    ),
    "an observation group goes away": method(
        """
        calls = 0

        @hookimpl
        def extend_observation(self, view):
            self.calls += 1
            return {"g": view.own} if self.calls < 12 else None
        """
    ),
    "state becomes what cannot be stored": method(
        """
        kept = None

        @hookimpl
        def iteration_finished(self, run):
            self.kept = run.iteration and print

        def state_dict(self):
            return {"kept": self.kept}

        def load_state_dict(self, state):
            self.kept = state["kept"]
        """
    ),
    "`evaluation_finished` fails": hook("evaluation_finished(result)", 'result["wins_rate"]'),
}

REMARKS = {
    "`shape_reward` forgets to return": hook("shape_reward(step)", 'bonus = {"b": step.reward}', code=0),
    "`shape_reward` is not marked": method("def shape_reward(self, step): return {}", code=0),
    "fills a hook that will go": method(
        """
        @hookimpl
        def old_hook(self, run):
            return None
        """,
        "hookspecs=__name__",
        """
        @hookspec(deprecated=Deprecation(since=1, removed_in=2, instead="fill run_started"))
        def old_hook(run): ...
        """,
        code=0,
    ),
    "takes an argument that will go": method(
        """
        @hookimpl
        def own_hook(self, step):
            return None
        """,
        "hookspecs=__name__",
        """
        @hookspec(deprecated_arguments={"step": Deprecation(since=1, removed_in=2, instead="take run")})
        def own_hook(run, step): ...
        """,
        code=0,
    ),
    "states no hook API version": Case("", CHECK, code=0),
    "its method's class is made by a function": Case(
        HEAD
        + textwrap.dedent(
            """
            def make(options, setup):
                return Method(options, setup)

            @hookimpl
            def register_methods():
                return [MethodSpec("bad", "bad:make")]
            """
        ),
        CHECK,
        code=0,
    ),
}

SECTIONS = {
    "Discovery": DISCOVERY,
    "Before the first step": BEFORE,
    "In the first iteration": FIRST,
    "Later": LATER,
    "Warnings": REMARKS,
}
"""Sections of the page, and the rows of each."""

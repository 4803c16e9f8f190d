"""The command tree. Each command's module is imported when it is called, so that ``apil --help`` is fast."""

from __future__ import annotations

from typing import get_args

from cyclopts import App, ArgumentCollection, CoercionError, Group, Parameter

from apil_core import __version__
from apil_core.common.numbers import whole_number

_HELP = (
    "Train and judge adversarial policies against deep-RL agents in two-player games.\n\n"
    "--trust (with any command): also run code that only a file names (python: and pettingzoo: names, "
    "one-file plugins): for files whose author you trust."
)

_WORK = Group("Train and evaluate", sort_key=0)
_LOOK = Group("List and check", sort_key=1)

_VERBS = (
    ("run", "run:run", _WORK, "Train an adversary against a frozen victim, then score it."),
    ("resume", "resume:resume", _WORK, "Continue a run exactly where it stopped, or extend a finished one."),
    ("eval", "evaluate:evaluate", _WORK, "Score an adversary: win, tie and loss rates with 95 % intervals."),
    ("play", "play:play", _WORK, "Watch two policies play: a window, a video or a contact sheet."),
    (
        "fidelity",
        "fidelity:fidelity",
        _WORK,
        "Compare the games with their originals: measured and published scores.",
    ),
    ("crossplay", "crossplay:crossplay", _WORK, "Score every adversary against every victim."),
    ("analyze", "analyze:app", _WORK, "Analyse the victim's activations against each opponent."),
    ("retrain", "retrain:retrain", _WORK, "Harden a victim against the adversaries of runs."),
    ("distill", "distill:distill", _WORK, "Train a compact student of a policy, to ship or to attack."),
    ("runs", "runs:app", _WORK, "List runs, compare their scores, draw their learning curves."),
    ("export", "export:export", _WORK, "Write a trained adversary as ONNX, TorchScript or safetensors."),
    ("bench", "bench:app", _WORK, "Measure attacks over methods, games and seeds."),
    ("tune", "tune:tune", _WORK, "Look for the settings of an attack that win most."),
    ("new", "new:app", _WORK, "Write a plugin package of your own: an attack method, a game or a victim."),
    ("config", "config:app", _WORK, "Show, validate, describe and compare configurations."),
    ("victims", "victims:app", _WORK, "List, check, import and download victims."),
    ("methods", "offers:methods", _LOOK, "List attack methods."),
    ("observers", "offers:observers", _LOOK, "List observers, such as defences."),
    ("games", "offers:games", _LOOK, "List games."),
    (
        "plugins",
        "offers:plugins",
        _LOOK,
        "List installed plugins, what they offer, and what is wrong with broken ones.",
    ),
    ("doctor", "doctor:doctor", _LOOK, "Check this machine: what works, what does not, and what to do."),
    ("completion", "completion:completion", _LOOK, "Print the shell's completion script."),
)


def make_app() -> App:
    """The command line as one cyclopts app."""
    app = App(
        name="apil",
        help=_HELP,
        help_format="plaintext",
        version=__version__,
        # --no-… and --empty-… variants of every flag would clutter the help
        default_parameter=Parameter(negative=()),
        config=read_whole_numbers,
        result_action="return_value",
        exit_on_error=False,
        print_error=False,
        suppress_keyboard_interrupt=False,
    )
    app["--help"].group = app["--version"].group = "Options"
    for order, (name, target, group, summary) in enumerate(_VERBS):
        app.command(f"apil_core.cli.{target}", name=name, group=group, help=summary, sort_key=order)
    return app


def sub_app(name: str, summary: str) -> App:
    """Make a group of commands (``apil NAME …``) with the same defaults."""
    return App(name=name, help=summary, default_parameter=Parameter(negative=()), help_format="plaintext")


def read_whole_numbers(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Parse 300k, 35M and 1e6 as whole numbers; reject 1.5, which cyclopts would round."""
    for argument in arguments:
        if int not in (argument.hint, *get_args(argument.hint)) or argument.parameter.converter:
            continue
        for place, token in enumerate(argument.tokens):
            try:
                argument.tokens[place] = token.evolve(value=str(whole_number(token.value)))
            except ValueError as error:
                text = f"{token.value!r} is not a whole number"
                raise CoercionError(msg=text, argument=argument, token=token) from error

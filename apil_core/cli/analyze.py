"""``apil analyze``: analyses of a victim's activations."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from apil_core.cli.app import sub_app
from apil_core.cli.crossplay import WHERE, names
from apil_core.cli.flags import Flags, Json, PairingFlags, Quiet, flags_of
from apil_core.cli.output import console, emit, print_facts, table
from apil_core.cli.progress import make_progress
from apil_core.common.errors import ConfigError
from apil_core.evaluation.options import PairingOptions
from apil_core.studies.activations.options import Sampling

if TYPE_CHECKING:
    from apil_core.studies.activations.models import ActivationMap, LogLikelihood

app = sub_app("analyze", "Analyse the victim's activations against each opponent.")

DOCUMENT, PICTURE = "activations.json", "activations.png"

_WHO = Group("Who plays", sort_key=0)
_HOW = Group("How much, and how", sort_key=2)


@flags_of(
    PairingOptions,
    {
        _WHO: ("victim",),
        WHERE: ("env", "physics", "adversary_actions", "victim_actions", "sets"),
        _HOW: ("seed", "num_envs", "threads"),
        None: ("plugin_files",),
    },
    {
        "victim": "Whose activations [default: the runs' victim, else the game's].",
        "env": "Game; needed if no opponent is a run.",
        "sets": "One option of the game (game.KEY); repeatable.",
    },
)
class OpponentFlags(PairingFlags):
    """Flags for the opponents and the game."""


@flags_of(Sampling, {_HOW: tuple(Sampling.model_fields)})
class SamplingFlags(Flags):
    """Flags for the number of games and the sampling."""


def activations(
    *opponents: Annotated[
        str,
        Parameter(
            name="OPPONENT",
            required=True,
            help="Run directories or policies (zoo:GAME/SIDE/v1, …), random, zero.",
        ),
    ],
    flags: OpponentFlags | None = None,
    baseline: Annotated[
        str | None, Parameter(group=_WHO, help="Opponent of normal play [default: the game's own].")
    ] = None,
    labels: Annotated[
        list[str] | None,
        names("What opponents are called [default: methods, policy names].", group=_WHO, metavar="LABEL,…"),
    ] = None,
    sampling: SamplingFlags | None = None,
    out: Annotated[
        Path | None,
        Parameter(help=f"JSON file, or a directory for {DOCUMENT} and {PICTURE}."),
    ] = None,
    picture: Annotated[Path | None, Parameter(help="Picture to draw: .png, .svg or .pdf.")] = None,
    force: Annotated[bool, Parameter(show_default=False, help="Replace those files if they exist.")] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Record the victim's last hidden layer against each opponent: a t-SNE map, and how usual it is.

    Usual means likely under a Gaussian mixture fitted on normal play, games against the game's baseline
    adversary (Gleave et al. 2020). Intervals are over games; normal play is scored on games of its own.
    """
    from apil_core.runs.labels import labelled
    from apil_core.studies.activations.analysis import analyze
    from apil_core.studies.activations.picture import draw_activations

    out, picture = _places(out, picture, force)
    options = (flags or OpponentFlags()).options(PairingOptions)
    with make_progress(quiet=quiet) as progress:
        found = analyze(
            labelled(opponents, labels, options.env, side="adversary"),
            PairingOptions.of(options, victim=None),
            victim=options.victim,
            baseline=baseline,
            sampling=Sampling(**(sampling or SamplingFlags()).given()),
            command=["apil", *sys.argv[1:]],
            progress=progress,
        )
    if out is not None:
        found.write(out)
    if picture is not None:
        draw_activations(found, picture)
    emit(found, as_json, lambda: _print(found, out, picture))


app.command(activations)


def _places(out: Path | None, picture: Path | None, force: bool) -> tuple[Path | None, Path | None]:
    """Paths of the JSON document and the picture; checked before minutes of playing."""
    from apil_core.common.charts import check_picture
    from apil_core.common.files import check_free, check_place

    if out is not None and out.suffix != ".json":
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"--out {out}: {error.strerror}") from error
        out, picture = out / DOCUMENT, picture or out / PICTURE
    if picture is not None:
        check_picture(picture)
    for path in (out, picture):
        if path is not None:
            check_place(path)
            check_free(path, force=force)
    return out, picture


def _print(found: ActivationMap, out: Path | None, picture: Path | None) -> None:
    from apil_core.cli.readout import game_name

    screen = console()
    title = f"{found.victim} in {game_name(found.env, found.physics)}: {found.layer}, {found.units} units"
    screen.print(title, style="bold")
    rows = table("opponent", "games>", "log-likelihood, nats>", "to baseline>", "", "seen>")
    for label, each in zip(found.opponents, found.log_likelihood, strict=True):
        interval = f"{each.mean:.1f} [{each.low:.1f}, {each.high:.1f}]"
        rows.add_row(label, str(each.n), interval, *_gap(each), f"{100 * each.explained:.1f} %")
    screen.print(rows)
    print_facts(**_facts(found), document=out, picture=picture)


def _gap(each: LogLikelihood) -> tuple[str, str]:
    gap = each.to_baseline
    if gap is None:
        return "–", ""
    text = f"{gap.value:+.1f} [{gap.low:.1f}, {gap.high:.1f}]"
    return text, "within noise" if gap.within_noise else ""


def _facts(found: ActivationMap) -> dict[str, str]:
    tried = ", ".join(f"{count}: {value:,.0f}" for count, value in found.bic.items())
    return {
        "density": f"{found.components} components over {found.dimensions} principal directions, "
        f"{100 * found.explained:.1f} % of the variance (BIC by components: {tried})",
        "fitted_on": f"{found.games_per_opponent} other games of normal play: "
        f"{found.fitted:.1f} nats on these",
        "intervals": "95 %, bootstrap over games; seen: share of the deviation in directions "
        "the density sees",
        "t-SNE": f"{sum(map(len, found.points)):,} points, perplexity {found.perplexity:g}",
        "seed": f"{found.seed}, {found.num_envs} games in parallel",
    }

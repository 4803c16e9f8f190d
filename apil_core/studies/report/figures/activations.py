"""Figures of the victim's activations: a t-SNE map, and log-likelihoods under normal play's density."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from apil_core.common.charts import Pen
from apil_core.studies.activations.models import ActivationMap
from apil_core.studies.report.figures.palette import pen_of
from apil_core.studies.report.figures.plot import Plot, listing
from apil_core.studies.report.words import percent, several

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def activation_plots(found: ActivationMap, pens: Mapping[str, Pen]) -> list[Plot]:
    """Draw a t-SNE map and the log-likelihoods of one game."""
    drawn = [pen_of(pens, name) for name in found.opponents]

    def cloud(axis: Axes) -> None:
        from apil_core.studies.activations.picture import draw_map

        draw_map(axis, found, drawn)

    def likelihood(axis: Axes) -> None:
        from apil_core.studies.activations.picture import draw_likelihood

        draw_likelihood(axis, found, drawn)

    counts = zip(found.opponents, (f"{len(points)} points" for points in found.points), strict=True)
    means = zip(found.opponents, (f"{each.mean:.1f}" for each in found.log_likelihood), strict=True)
    return [
        Plot(
            cloud,
            title=f"{found.env}: t-SNE of {found.layer}",
            alt=f"t-SNE map of the victim's activations in {found.env}: {listing(counts)}.",
            caption=f"Victim {found.victim}. {_notes(found)}",
            facets={"game": found.env},
            height=3.4,
        ),
        Plot(
            likelihood,
            title=f"{found.env}: log-likelihood of the activations, nats",
            alt=f"Mean log-likelihood of the victim's activations in {found.env}: {listing(means)}.",
            caption="Mean under a Gaussian mixture fitted on games against the baseline; 95 % interval.",
            facets={"game": found.env},
            height=0.7 + 0.4 * len(found.opponents),
        ),
    ]


def _notes(found: ActivationMap) -> str:
    lost = max(1.0 - each.explained for each in found.log_likelihood)
    physics = f", {found.physics} physics" if found.physics else ""
    return (
        f"{several(found.games_per_opponent, 'game')} against each opponent{physics}; t-SNE with perplexity "
        f"{found.perplexity:g}. Density of normal play: a mixture of {several(found.components, 'Gaussian')} "
        f"in {found.dimensions} directions with {percent(found.explained)} % of its variance; up to "
        f"{percent(lost)} % of an opponent's deviation lies outside them and does not count. The samples it "
        f"was fitted on have {found.fitted:.1f} nats; held-out normal play much below that would mean too "
        "few games."
    )

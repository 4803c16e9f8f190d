"""The victim's activations: a t-SNE map, and how usual they are under the density of normal play."""

from __future__ import annotations

from collections.abc import Sequence

from apil_core.studies.report.figures.palette import Pen, pen_of
from apil_core.studies.report.figures.plot import Plot, axis_title, error_bar, listing, rounded, spec, text
from apil_core.studies.report.models import Activations


def activation_plots(activations: Sequence[Activations], found: dict[str, Pen]) -> list[Plot]:
    """For each game a map, and the log-likelihoods if there are any."""
    plots = []
    for activation in activations:
        plots.append(_map(activation, found))
        if any(cloud.log_likelihood is not None for cloud in activation.clouds):
            plots.append(_likelihood(activation, found))
    return plots


def _map(activation: Activations, found: dict[str, Pen]) -> Plot:
    traces = []
    for cloud in activation.clouds:
        pen = pen_of(found, cloud.opponent)
        traces.append(
            {
                "type": "scatter",
                "x": rounded([x for x, _ in cloud.points]),
                "y": rounded([y for _, y in cloud.points]),
                "name": text(cloud.opponent),
                "mode": "markers",
                "marker": {"color": pen.colour, "symbol": pen.symbol, "size": 5, "opacity": 0.7},
                "hovertemplate": "against %{fullData.name}<extra></extra>",
                "meta": {"method": pen.name},
            }
        )
    margin = dict.fromkeys("lrtb", 8)
    figure = spec(traces, 360, x={"visible": False}, y={"visible": False}, hovermode="closest", margin=margin)
    counts = [(cloud.opponent, f"{len(cloud.points)} points") for cloud in activation.clouds]
    return Plot(
        figure,
        title=f"{activation.game}: t-SNE of {activation.layer}",
        alt=f"t-SNE map of the victim's activations in {activation.game}: {listing(counts)}.",
        caption=f"Victim {activation.victim}. " + " ".join(activation.notes),
        facets={"game": activation.game},
    )


def _likelihood(activation: Activations, found: dict[str, Pen]) -> Plot:
    traces, values = [], []
    for cloud in activation.clouds:
        if cloud.log_likelihood is None:
            continue
        pen, value = pen_of(found, cloud.opponent), cloud.log_likelihood
        low, high = (value if end is None else end for end in (cloud.low, cloud.high))
        values.append((cloud.opponent, f"{value:.1f}"))
        traces.append(
            {
                "type": "scatter",
                "x": rounded([value]),
                "y": [text(cloud.opponent)],
                "error_x": error_bar([(value, low, high)], pen.colour),
                "mode": "markers",
                "marker": {"color": pen.colour, "symbol": pen.symbol, "size": 11},
                "hovertemplate": "against %{y}: %{x:.1f} nats<extra></extra>",
                "meta": {"method": pen.name},
            }
        )
    figure = spec(
        traces,
        max(74 + 34 * len(traces), 170),
        x={"title": axis_title("log-likelihood, nats (lower: less usual)")},
        y={"type": "category", "autorange": "reversed"},
        margin={"l": 70, "r": 14, "t": 8, "b": 44},
    )
    return Plot(
        figure,
        title=f"{activation.game}: how usual the activations are",
        alt=f"Mean log-likelihood of the victim's activations in {activation.game}: {listing(values)}.",
        caption="Mean under a Gaussian mixture fitted on games against the baseline; 95 % interval.",
        facets={"game": activation.game},
    )

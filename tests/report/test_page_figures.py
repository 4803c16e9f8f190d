"""The page's figures: the numbers that go in are the numbers that are drawn."""

from __future__ import annotations

import plotly.graph_objects as go
import pytest

from apil_core.common import colours
from apil_core.studies.curves.curves import WIN, WIN_OR_TIE
from apil_core.studies.report.figures import palette
from apil_core.studies.report.figures.activations import activation_plots
from apil_core.studies.report.figures.curves import learning_curves, retraining_curves
from apil_core.studies.report.figures.diagnostics import diagnostic_plots
from apil_core.studies.report.figures.dots import ablation_dots, aggregate_dots
from apil_core.studies.report.figures.endings import SEEING, ending_bars
from apil_core.studies.report.figures.heat import crossplay_maps
from apil_core.studies.report.figures.plot import scale_top
from apil_core.studies.report.models import Evidence
from apil_core.studies.report.page import render
from apil_core.studies.report.page_sections import sections
from report import page_sample

SETTINGS = {"s1": "main"}


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return page_sample.evidence()


@pytest.fixture(scope="module")
def pens(evidence: Evidence) -> dict[str, palette.Pen]:
    return palette.pens(evidence.columns)


def test_plotly_knows_every_name_and_value(evidence, pens):
    plots = [plot for section in sections(evidence, pens) for plot in section.plots]
    assert len(plots) > 20
    for plot in plots:
        go.Figure(plot.figure)  # raises for anything that plotly.js would ignore in silence
        assert plot.alt
        assert plot.title


def test_learning_curves_are_the_lines_in_percent_with_their_bands(evidence, pens):
    panel = evidence.curves[0]
    plot = learning_curves([panel], pens, SETTINGS)[0]
    line = panel.lines[0].lines[WIN]
    low, high, middle = plot.figure["data"][:3]
    assert middle["x"] == line.steps
    assert middle["y"] == pytest.approx([100 * v for v in line.value], abs=0.005)
    assert low["y"] == pytest.approx([100 * v for v in line.low], abs=0.005)
    assert high["y"] == pytest.approx([100 * v for v in line.high], abs=0.005)
    assert high["fill"] == "tonexty"
    assert middle["line"]["color"] == pens["adrl"].colour
    assert plot.figure["layout"]["shapes"][0]["y0"] == 28.4
    assert plot.facets == {"game": panel.game, "measure": WIN, "setting": "s1"}
    assert f"adrl {100 * line.value[-1]:.1f} %" in plot.alt


def test_scores_are_points_with_their_intervals(evidence, pens):
    panel = evidence.curves[0]
    rate = panel.lines[0].scores[0].win
    traces = learning_curves([panel], pens, SETTINGS)[0].figure["data"]
    point = next(t for t in traces if t.get("name") == "adrl, scored")
    assert point["y"] == [pytest.approx(100 * rate.value, abs=0.005)]
    assert point["error_y"]["array"] == [pytest.approx(100 * (rate.high - rate.value), abs=0.02)]
    assert point["error_y"]["arrayminus"] == [pytest.approx(100 * (rate.value - rate.low), abs=0.02)]


def test_both_shares_of_a_game_have_one_scale_from_nought(evidence, pens):
    plots = learning_curves(evidence.curves[:1], pens, SETTINGS)
    ranges = {p.facets["measure"]: p.figure["layout"]["yaxis"].get("range") for p in plots}
    assert ranges[WIN] == ranges[WIN_OR_TIE]
    assert ranges[WIN][0] == 0


def test_retraining_shows_each_opponent_on_its_own(evidence, pens):
    curve = evidence.retraining[0]
    plot = retraining_curves([curve], pens)[0]
    middles = {t["name"]: t["y"] for t in plot.figure["data"] if "name" in t}
    assert list(middles) == ["against baseline", "against apil"]
    assert middles["against apil"] == pytest.approx([100 * v for v in curve.lines[1].win.value], abs=0.005)
    assert plot.caption == "1 M of 10 M steps, stopped."


def test_endings_add_up_and_keep_their_counts(evidence, pens):
    game = evidence.games[0]
    group = [e for e in evidence.endings if e.game == game and e.table == "t1-s1"]
    outcome, cause = ending_bars(group, {"t1-s1": SEEING}, SETTINGS)
    wins, ties, losses = outcome.figure["data"]
    assert wins["customdata"] == [e.wins for e in group]
    assert wins["x"] == pytest.approx([100 * e.wins / e.episodes for e in group], abs=0.005)
    for shares in zip(wins["x"], ties["x"], losses["x"], strict=True):
        assert sum(shares) == pytest.approx(100, abs=0.02)
    by_name = {t["name"]: t["customdata"] for t in cause.figure["data"]}
    assert by_name["goal"] == [e.causes["goal"] for e in group]


def test_games_without_endings_have_no_bar(evidence, pens):
    empty = [e.model_copy(update={"episodes": 0}) for e in evidence.endings]
    assert ending_bars(empty, {}, SETTINGS) == []


def test_crossplay_map_has_adversaries_in_rows_and_values_in_fields(evidence):
    matrix = evidence.crossplay[0]
    figure = crossplay_maps([matrix])[0].figure
    trace = figure["data"][0]
    assert trace["z"][1][2] == pytest.approx(100 * matrix.win[1][2].value, abs=0.005)
    assert trace["text"][1][2].startswith(f"{100 * matrix.win[1][2].value:.1f}<br>")
    assert trace["y"] == matrix.adversaries
    assert trace["x"] == matrix.victims
    assert figure["layout"]["yaxis"]["autorange"] == "reversed"  # first row on top, as in tables


def test_pairings_to_come_are_empty_fields(evidence):
    matrix = evidence.crossplay[0].model_copy(deep=True)
    matrix.win[1][2] = matrix.win_or_tie[1][2] = None
    plot = crossplay_maps([matrix])[0]
    trace = go.Figure(plot.figure).data[0]
    assert (trace.z[1][2], trace.text[1][2]) == (None, "")
    assert f"{matrix.victims[2]} not yet" in plot.alt
    assert "not played yet" in render(evidence.model_copy(update={"crossplay": [matrix]}))


def test_ablation_dots_have_values_and_intervals(evidence):
    ablation = evidence.ablations[0]
    trace = ablation_dots([ablation], SETTINGS)[0].figure["data"][0]
    share = ablation.rows[1].cell.win.measured
    assert share is not None
    assert trace["y"] == [row.value for row in ablation.rows]
    assert trace["x"][1] == pytest.approx(100 * share.value, abs=0.005)
    assert trace["error_x"]["array"][1] == pytest.approx(100 * (share.high - share.value), abs=0.02)


def test_aggregates_without_interval_have_no_error_bar(evidence, pens):
    group = [a for a in evidence.aggregates if a.metric == "win" and a.column in ("apl", "apil")]
    without, with_interval = aggregate_dots(group, pens, SETTINGS)[0].figure["data"]
    assert without["error_x"]["array"] == [0]
    assert with_interval["error_x"]["array"] == [pytest.approx(5.0)]
    assert with_interval["error_x"]["arrayminus"] == [pytest.approx(6.0)]


def test_activation_points_and_likelihoods(evidence, pens):
    cloud = evidence.activations[0].clouds[1]
    points, dots = activation_plots(evidence.activations[:1], pens)
    assert points.figure["data"][1]["x"] == pytest.approx([x for x, _ in cloud.points], rel=1e-4)
    assert dots.figure["data"][1]["x"] == [cloud.log_likelihood]
    assert dots.figure["data"][1]["error_x"]["array"] == [3.0]


def test_diagnostics_over_decades_have_a_logarithmic_axis(evidence, pens):
    diagnostic = evidence.diagnostics[0]
    line = diagnostic.lines["kl"]
    wide = diagnostic.model_copy(
        update={"lines": {"kl": line.model_copy(update={"value": [1e-4, *line.value[1:]]})}}
    )
    plain, logarithmic = (diagnostic_plots([d], pens, SETTINGS)[0] for d in (diagnostic, wide))
    assert plain.figure["data"][0]["y"] == pytest.approx(line.value, rel=1e-4)
    assert "type" not in plain.figure["layout"]["yaxis"]
    assert logarithmic.figure["layout"]["yaxis"]["type"] == "log"


def test_methods_have_the_projects_colours_wherever_they_appear(pens):
    found = {name: light for name, light, _ in palette.variables()}
    for i, method in enumerate(("adrl", "apl", "apil", "e_apil")):
        assert pens[method].name == f"line-{i}"
        assert found[f"line-{i}"] == palette.css(colours.LINES[i])
    assert palette.pen_of(pens, "vs apil") == palette.pen_of(pens, "apil/s1") == pens["apil"]
    assert palette.pen_of(pens, "unknown").name == "line-baseline"
    assert len({(pen.name, pen.dash) for pen in pens.values()}) == len(pens)
    assert len({pen.symbol for pen in pens.values()}) == len(pens)


def test_colours_stand_out_from_the_dark_ground():
    ground = _luminance((20, 23, 28))
    for colour in (*colours.LINES, colours.NEUTRAL):
        contrast = (_luminance(palette.on_dark(colour)) + 0.05) / (ground + 0.05)
        assert contrast >= 3, colour  # WCAG 2.2, 1.4.11: graphics


@pytest.mark.parametrize(("highest", "top"), [(0, 10), (8, 10), (8.1, 20), (55, 60), (97, 100), (99, 102)])
def test_scales_end_at_a_round_number_above_the_highest(highest, top):
    assert scale_top(highest) == top


def _luminance(colour: tuple[int, int, int]) -> float:
    parts = [c / 255 for c in colour]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue

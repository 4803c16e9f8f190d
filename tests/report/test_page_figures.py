"""The page's figures: the numbers that go in are the numbers that are drawn."""

from __future__ import annotations

import re
from typing import Any

import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from apil_core.common import colours
from apil_core.common.charts import Pen, web
from apil_core.studies.curves.curves import WIN, WIN_OR_TIE
from apil_core.studies.report.figures import palette
from apil_core.studies.report.figures.activations import activation_plots
from apil_core.studies.report.figures.crossplay import crossplay_map
from apil_core.studies.report.figures.curves import diagnostic_plots, learning_curve, retraining_curve
from apil_core.studies.report.figures.dots import ablated, improved, means, performance
from apil_core.studies.report.figures.endings import ending_bars
from apil_core.studies.report.figures.plot import Plot, scale_top
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.page_sections import sections
from report import page_sample

SETTINGS = {"s1": "main"}


@pytest.fixture(scope="module")
def data() -> ReportData:
    return page_sample.report_data()


@pytest.fixture(scope="module")
def pens(data: ReportData) -> dict[str, Pen]:
    return palette.pens(data.columns)


def drawn(plot: Plot) -> Any:
    axis = Figure().subplots()
    plot.draw(axis)
    return axis


def whiskers(axis: Any) -> list[tuple[float, float, float]]:
    """Value, low and high of every mark with a level interval."""
    found = []
    for container in axis.containers:
        line, _, (bar,) = container.lines
        (low, _), (high, _) = bar.get_segments()[0]
        found.append((float(line.get_xdata()[0]), float(low), float(high)))
    return found


def test_every_figure_is_drawn_and_has_words(data, pens):
    plots = [plot for section in sections(data, pens) for plot in section.plots]
    assert len(plots) > 20
    assert all(plot.alt and plot.title for plot in plots)
    assert len({(plot.title, plot.caption) for plot in plots}) == len(plots)


def test_the_page_has_variables_for_placeholders(data, pens):
    """No placeholder is left, no colour is of one theme only, and ids differ from figure to figure."""
    plot = learning_curve(data.curves[0], WIN, pens, SETTINGS)
    svg, again = str(plot.svg("a")), str(plot.svg("a"))
    assert svg == again
    assert svg.startswith('<svg viewBox="0 0 360 ')
    assert "var(--line-0)" in svg
    assert "var(--ink)" in svg
    assert not re.search(r"#[0-9a-f]{6}\b|<style|metadata|DejaVu", svg)
    ids = [set(re.findall(r' id="([^"]+)"', str(text))) for text in (svg, plot.svg("b"))]
    assert ids[0]
    assert not ids[0] & ids[1]


def test_a_name_that_looks_like_a_placeholder_stays_text(data):
    aggregate = data.aggregates[0].model_copy(update={"column": "#0b00fe"})
    svg = str(means([aggregate], {}, {}).svg("a"))
    assert ">#0b00fe</text>" in svg


def test_learning_curves_are_the_lines_in_percent_with_their_bands(data, pens):
    panel = data.curves[0]
    plot = learning_curve(panel, WIN, pens, SETTINGS)
    axis, line = drawn(plot), panel.groups[0].lines[WIN]
    middle = axis.lines[0]
    assert list(middle.get_xdata()) == line.steps
    assert list(middle.get_ydata()) == pytest.approx([100 * v for v in line.value])
    assert middle.get_color() == pens["adrl"].colour
    band = axis.collections[0].get_paths()[0].vertices
    assert band[:, 1].max() == pytest.approx(100 * max(line.high))
    assert band[:, 1].min() == pytest.approx(100 * min(line.low))
    assert [text.get_text() for text in axis.texts] == ["baseline 28.4 %"]
    assert plot.facets == {"game": panel.game, "measure": WIN, "setting": "s1"}
    assert f"adrl {100 * line.value[-1]:.1f} %" in plot.alt


def test_scores_are_points_with_their_intervals(data, pens):
    panel = data.curves[0]
    rate = panel.groups[0].curves[0].scores[0].win
    line, _, (bar,) = drawn(learning_curve(panel, WIN, pens, SETTINGS)).containers[0].lines
    assert line.get_ydata()[0] == pytest.approx(100 * rate.value)
    (_, low), (_, high) = bar.get_segments()[0]
    assert (low, high) == pytest.approx((100 * rate.low, 100 * rate.high))


def test_both_shares_of_a_game_have_one_scale_from_nought(data, pens):
    shares = (WIN, WIN_OR_TIE)
    scales = [drawn(learning_curve(data.curves[0], name, pens, SETTINGS)).get_ylim() for name in shares]
    assert scales[0] == scales[1]
    assert scales[0][0] == 0


def test_retraining_shows_each_opponent_on_its_own(data, pens):
    curve = data.retraining[0]
    plot = retraining_curve(curve, WIN, pens)
    axis = drawn(plot)
    assert [line.get_label() for line in axis.lines] == ["baseline", "apil"]
    expected = [100 * v for v in curve.groups[1].lines[WIN].value]
    assert list(axis.lines[1].get_ydata()) == pytest.approx(expected)
    assert axis.lines[1].get_color() == pens["apil"].colour
    assert plot.caption == "1 M of 10 M steps, stopped."


def test_endings_add_up(data, pens):
    table = next(table for table in data.tables if table.id == "t1-s1")
    row = table.rows[0]
    only = table.model_copy(update={"rows": [row]})
    outcome, cause = (drawn(plot) for plot in ending_bars([only], SETTINGS))
    wins, _, losses = outcome.containers
    widths = [bar.get_width() for bar in wins]
    assert widths == pytest.approx([100 * c.total("wins") / c.episodes for c in row])
    assert [bar.get_x() + bar.get_width() for bar in losses] == pytest.approx([100] * len(row))
    goal = next(bars for bars in cause.containers if bars.get_label() == "goal")
    counted = [100 * sum(s.causes["goal"] for s in c.scores) / c.episodes for c in row]
    assert [b.get_width() for b in goal] == pytest.approx(counted)


def test_games_without_endings_have_no_bar(data):
    rows = [[cell.model_copy(update={"scores": []}) for cell in data.tables[0].rows[0]]]
    assert ending_bars([data.tables[0].model_copy(update={"rows": rows})], SETTINGS) == []


def test_crossplay_map_has_adversaries_in_rows_and_values_in_fields(data):
    document = data.crossplay[0]
    plot = crossplay_map(document, "win")
    axis = drawn(plot)
    rate = document.scores[1][2].win_rate
    assert axis.collections[0].get_array()[1, 2] == pytest.approx(rate.value)
    text = next(t for t in axis.texts if t.get_position() == (2.5, 1.5)).get_text()
    assert text == f"{100 * rate.value:.1f}\n[{100 * rate.low:.1f}, {100 * rate.high:.1f}]"
    assert [label.get_text() for label in axis.get_yticklabels()] == [p.label for p in document.adversaries]
    assert axis.get_ylim() == (5, 0)  # first row on top, as in tables


def test_pairings_to_come_are_empty_fields(data):
    document = data.crossplay[0].model_copy(deep=True)
    document.scores[1][2] = None
    plot = crossplay_map(document, "win")
    assert drawn(plot).collections[0].get_array().mask[1, 2]
    assert len(drawn(plot).texts) == 24
    assert f"{document.victims[2].label} not yet" in plot.alt


def test_ablation_dots_have_values_and_intervals(data):
    ablation = data.ablations[0]
    axis = drawn(ablated(ablation, SETTINGS))
    share = ablation.rows[1].cell.win.measured
    assert share is not None
    assert [label.get_text() for label in axis.get_yticklabels()] == [row.value for row in ablation.rows]
    expected = [100 * end for end in (share.value, share.low, share.high)]
    assert whiskers(axis)[3] == pytest.approx(expected)  # win or tie first, in each row


def test_aggregates_without_interval_have_no_error_bar(data, pens):
    group = [a for a in data.aggregates if a.metric == "win" and a.column in ("apl", "apil")]
    without, with_interval = whiskers(drawn(means(group, pens, SETTINGS)))
    assert without == pytest.approx((40, 40, 40))
    assert with_interval == pytest.approx((50, 44, 55))


def test_a_profile_is_drawn_in_percent_with_its_band_and_its_runs(data, pens):
    group = [each for each in data.profiles if each.metric == "win"]
    plot = performance(group, pens, {})
    axis = drawn(plot)
    assert list(axis.lines[0].get_ydata()) == pytest.approx([100 * v for v in group[0].value])
    assert axis.lines[0].get_color() == pens["adrl"].colour
    assert axis.collections[0].get_paths()[0].vertices[:, 1].max() == pytest.approx(100 * max(group[0].high))
    assert plot.caption.startswith("Runs: adrl 6, apl 6, ")
    assert f"adrl {100 * group[0].value[50]:.1f} %" in plot.alt


def test_probabilities_of_improvement_have_a_row_for_each_pair(data, pens):
    group = [each for each in data.improvements if each.metric == "win" and each.column in ("apl", "apil")]
    axis = drawn(improved(group, pens, SETTINGS))
    assert [label.get_text() for label in axis.get_yticklabels()] == ["apl over adrl", "apil over adrl"]
    assert whiskers(axis) == [pytest.approx((60, 40, 80))] * 2
    assert list(axis.lines[-1].get_xdata()) == [50, 50]


def test_activation_points_and_likelihoods(data, pens):
    found = data.activations[0]
    cloud, dots = activation_plots(found, pens)
    patch = drawn(cloud).patches[1]
    assert patch.get_path().vertices[::2].tolist() == [list(point) for point in found.points[1]]
    assert to_hex(patch.get_edgecolor()) == pens["adrl"].colour
    each = found.log_likelihood[1]
    assert whiskers(drawn(dots))[1] == pytest.approx((each.mean, each.low, each.high))


def test_diagnostics_over_decades_have_a_logarithmic_axis(data, pens):
    diagnostic = data.diagnostics[0]
    line = diagnostic.lines["kl"]
    wide = diagnostic.model_copy(
        update={"lines": {"kl": line.model_copy(update={"value": [1e-4, *line.value[1:]]})}}
    )
    plain, logarithmic = (drawn(diagnostic_plots([d], pens, SETTINGS)[0]) for d in (diagnostic, wide))
    assert list(plain.lines[0].get_ydata()) == line.value
    assert (plain.get_yscale(), logarithmic.get_yscale()) == ("linear", "log")


def test_methods_have_the_projects_colours_wherever_they_appear(pens):
    found = {name: light for name, light, _ in palette.variables()}
    for i, method in enumerate(("adrl", "apl", "apil", "e_apil")):
        assert palette.with_variables(pens[method].colour) == f"var(--line-{i})"
        assert found[f"line-{i}"] == web(colours.LINES[i])
    assert palette.pen_of(pens, "vs apil") == palette.pen_of(pens, "apil/s1") == pens["apil"]
    assert palette.pen_of(pens, "unknown").colour == pens["baseline"].colour
    many = palette.pens(["baseline", *(f"m{i}" for i in range(20))])
    assert len({(pen.colour, pen.dashes) for pen in many.values()}) == 21


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

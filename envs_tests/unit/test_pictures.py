"""What the pictures draw: wake, Campbell diagram, and the look they share."""

from pathlib import Path

import numpy as np
import pytest
import validation_pictures as pictures
from matplotlib.figure import Figure

from envs_tests.physics.validation import CaseResult, Check, Curve, absolute, read_record
from envs_tests.physics.validation import Figure as CaseFigure
from wt_gym.analysis.scene import Camera, Scene, filament_weights, smooth_curves
from wt_gym.simulation.campbell import FAMILIES, CampbellDiagram, campbell_figure, mode_family, mode_label, spread
from wt_gym.turbines import load_turbine

ROOT = Path(__file__).resolve().parents[2]
RADIUS, HUB = 60.0, np.array([0.0, 0.0, 90.0])


def helix(angles, n_blades=3, radii=(2.0, 20.0, 40.0, 55.0, RADIUS)):
    """Nodes of helices that drift 8 m a radian, shape (n_rows, n_blades, n_span + 1, 3)."""
    angle = angles[:, None, None] + 2.0 * np.pi / n_blades * np.arange(n_blades)[:, None]
    radius = np.broadcast_to(radii, (len(angles), n_blades, len(radii)))
    drift = np.broadcast_to(8.0 * angles[:, None, None], radius.shape)
    return HUB + np.stack([drift, radius * np.sin(angle), radius * np.cos(angle)], axis=-1)


def geometry(n_rows=40):
    """Shapes of a turbine with a regular wake: strong tips, stronger roots."""
    nodes = helix(np.linspace(0.0, 4.0 * np.pi, n_rows + 1))
    leading, trailing = nodes[0], nodes[0] + [2.0, 0.0, 0.0]
    return {
        "blades": np.stack([leading, trailing], axis=1),
        "wake": nodes,
        "wake_circulation": np.broadcast_to([30.0, 28.0, 26.0, 24.0], (n_rows, 3, 4)),
        "tower": np.column_stack([np.full(5, 4.0), np.zeros(5), np.linspace(0.0, 88.0, 5)]),
        "tower_radius": np.linspace(3.0, 2.0, 5),
        "hub": HUB,
    }


def test_curves_pass_through_the_nodes_of_rows_at_unequal_distances():
    rows = np.concatenate([np.arange(0.0, 2.0, 0.14), np.arange(2.1, 12.0, 0.42)])  # old rows are thinned
    nodes = helix(rows)
    curves = smooth_curves(nodes, 6)
    assert len(curves) == 6 * (len(rows) - 1) + 1
    np.testing.assert_allclose(curves[::6], nodes, atol=1e-9)
    tips = smooth_curves(helix(np.arange(0.0, 12.0, 0.42)), 8)[16:-16, 0, -1] - HUB
    sagitta = RADIUS * (1.0 - np.cos(0.5 * 0.42))  # of a straight piece
    assert np.abs(np.hypot(tips[:, 1], tips[:, 2]) - RADIUS).max() < 0.05 * sagitta


@pytest.mark.parametrize("n_rows", [0, 1, 2])
def test_a_short_wake_is_drawn_too(n_rows):
    shapes = geometry(max(n_rows, 1))
    shapes["wake"] = shapes["wake"][: n_rows + 1]
    shapes["wake_circulation"] = shapes["wake_circulation"][:n_rows]
    assert len(smooth_curves(shapes["wake"], 5)) == 5 * n_rows + 1
    scene = Scene(Figure().add_axes((0, 0, 1, 1)), load_turbine("nrel_5mw"))
    scene.draw(shapes)


def test_tips_come_before_roots_and_old_filaments_fade():
    shapes = geometry()
    weights = filament_weights(shapes["wake_circulation"], shapes["wake"], HUB)
    assert weights.shape == (40, 3, 5)
    assert weights[0, 0, -1] == pytest.approx(1.0)  # 24 m²/s leave the tip
    assert weights[0, 0, 0] < 0.5 * weights[0, 0, -1]  # 30 leave the root
    assert np.all(np.diff(weights[:, 0, -1]) <= 0.0)
    assert weights[-1, 0, -1] < 0.1
    doubled = shapes["wake_circulation"].copy()
    doubled[:, 0] *= 0.5  # one blade is loaded half as much
    halves = filament_weights(doubled, shapes["wake"], HUB)
    np.testing.assert_allclose(halves[:, 0, -1], 0.5 * halves[:, 1, -1])


def test_scene_draws_filaments_on_both_sides_of_the_tower_with_widths_by_strength():
    figure = Figure(figsize=(4, 3))
    scene = Scene(figure.add_axes((0, 0, 1, 1)), load_turbine("nrel_5mw"), length=1.2)
    shapes = geometry()
    scene.draw(shapes)
    for lines in (scene._behind, scene._before):
        widths, opacities = lines.get_linewidths(), lines.get_colors()[:, 3]
        assert len(lines.get_segments()) == len(widths) == len(opacities) > 20
        assert np.all(np.diff(widths) >= 0.0)  # the strongest last, on top
        np.testing.assert_allclose(np.argsort(widths, kind="stable"), np.argsort(opacities, kind="stable"))
        # a piece begins and ends at nodes of the wake
        ends = np.array([[line[0], line[-1]] for line in lines.get_segments()]).reshape(-1, 1, 2)
        known = scene.camera.project(shapes["wake"]).reshape(1, -1, 2)
        assert np.abs(ends - known).max(axis=2).min(axis=1).max() < 1e-9
    left, right = figure.axes[0].get_xlim()
    drawn = np.concatenate([line for line in scene._before.get_segments()])
    assert left < drawn[:, 0].min()
    assert drawn[:, 0].max() < right  # nothing is cut at the edge
    rim = scene._rim.get_segments()[0]
    tips = scene.camera.project(0.5 * (shapes["blades"][:, 0, -1] + shapes["blades"][:, -1, -1]))
    assert np.linalg.norm(rim[:, None] - tips, axis=-1).min(axis=0).max() < 3.0  # the disc goes through the tips


def test_camera_looks_from_above():
    camera = Camera()
    near, far = np.array([0.0, -50.0, 0.0]), np.array([0.0, 50.0, 0.0])
    assert camera.depth(far) > camera.depth(near)
    assert camera.project(far)[1] > camera.project(near)[1]  # what is farther on the ground is higher in the picture
    assert camera.project([0.0, 0.0, 10.0])[1] > 0.0
    assert camera.project([10.0, 0.0, 0.0])[0] > 0.0  # downwind is to the right


def test_scene_draws_the_sea_from_far_to_near_and_members_as_thick_as_they_are():
    scene = Scene(Figure().add_axes((0, 0, 1, 1)), load_turbine("volturnus_iea_15mw"))
    x, y = np.meshgrid(np.linspace(-100.0, 400.0, 21), [-100.0, 0.0, 100.0], indexing="ij")
    pontoon = {"platform": np.array([[[0.0, 0.0, -16.5], [45.5, 0.0, -16.5]]]), "platform_radius": np.array([3.5])}
    scene.draw(geometry() | pontoon | {"sea": np.stack([x, y, np.where(x < 150.0, 2.0, -2.0)], axis=2)})
    low, *_, high = np.unique(scene._floor.get_facecolors()[:, :3].sum(axis=1))
    assert len(scene._floor.get_paths()) == 40
    assert low < scene._floor.get_facecolors()[-1, :3].sum() == high  # the crest is nearer than the trough
    corners = scene._submerged.get_paths()[-1].vertices
    assert np.linalg.norm(corners[0] - corners[3]) == pytest.approx(7.0)


@pytest.mark.parametrize(("name", "family", "label"), [
    ("flap_1 regressive", "blade flap", "blade flap 1, regressive"), ("torsion_1", "tower torsion", "tower torsion 1"),
    ("torsion_1 progressive", "blade torsion", "blade torsion 1, progressive"),
    ("shaft_torsion", "drivetrain torsion", "drivetrain torsion"),
    ("side_side_1", "tower side-side", "tower side-side 1"), ("platform_surge", "platform_surge", "platform surge"),
])  # fmt: skip
def test_modes_have_names_that_say_what_moves(name, family, label):
    assert mode_family(name) == family
    assert mode_label(name) == label


def test_labels_keep_their_order_and_distance():
    places = np.array([0.30, 0.31, 0.9, 0.32, 0.97])
    out = spread(places, 0.1, 0.0, 1.0)
    assert np.all(np.argsort(out) == np.argsort(places))
    assert np.diff(np.sort(out)).min() > 0.1 - 1e-12
    np.testing.assert_allclose(spread([0.1, 0.5, 0.9], 0.1, 0.0, 1.0), [0.1, 0.5, 0.9])  # those with room stay
    crowded = spread(np.full(30, 0.5), 0.1, 0.0, 1.0)
    assert crowded.min() >= -1e-12
    assert crowded.max() <= 1.0 + 1e-12


def diagram(damping, generator="free"):
    speeds = np.array([4.0, 11.0, 20.0])
    names = ("fore_aft_1", "flap_1 regressive", "torsion_1")
    frequency = np.array([[0.32, 0.32, 0.33], [0.7, 0.6, 0.5], [3.4, np.nan, 3.3]])
    return CampbellDiagram("wind_speed", speeds, np.array([0.8, 1.2, 1.27]), 0.0 * speeds, names, frequency,
                           np.broadcast_to(np.array(damping)[:, None], (3, 3)), "A turbine", "in operation", generator,
                           11.4)  # fmt: skip


def texts(figure):
    return [text.get_text() for axes in figure.axes for text in axes.texts] + [text.get_text() for text in figure.texts]


def test_campbell_figure_names_modes_harmonics_rated_speed_and_generator():
    figure = campbell_figure(diagram([0.08, 0.5, 0.004]))
    shown = texts(figure)
    for text in ("tower fore-aft 1", "blade flap 1, regressive", "tower torsion 1"):
        assert shown.count(text) == 2, text  # frequency and damping
    for text in (*(f"{n}P" for n in range(1, 10)), "rated"):
        assert text in shown
    assert any("generator free (constant torque)" in text for text in shown)
    assert "unstable" not in shown
    flap = [line for line in figure.axes[0].lines if line.get_color() == FAMILIES["blade flap"]]
    assert "--" in {line.get_linestyle() for line in flap}


def test_damping_axis_spreads_what_is_lightly_damped_and_marks_what_is_unstable():
    figure = campbell_figure(diagram([0.08, 0.5, -0.004], "locked"))
    damping = figure.axes[1]
    to_axes = (damping.transData + damping.transAxes.inverted()).transform
    quarter = to_axes((4.0, 1.0))[1] - to_axes((4.0, 0.0))[1]
    assert quarter > 0.1  # the first per cent has a tenth of the axis, of a range of 100
    assert "unstable" in texts(figure)
    assert damping.get_ylim()[0] < -0.4


def check(expected, obtained, tolerance, quantity="x"):
    return Check(quantity, expected, obtained, tolerance).as_dict()


@pytest.mark.parametrize(("checks", "margin"), [
    ([check(2.0, 2.1, 0.1), check(1.0, 1.0, 0.1)], 0.5),  # half of the tolerance
    ([check(2.0, 2.6, 0.1)], 3.0), ([check("<= 2", 1.0, 0.0)], None), ([check("<= 2", 3.0, 0.0)], 1.5),
    ([check("in [1, 3]", 4.0, 0.0)], 1.5), ([check(0.0, 0.2, absolute(0.1))], 2.0),
    ([check(">= 0", -0.3, 0.0)], 2.0),  # a sign
])  # fmt: skip
def test_bars_measure_errors_in_tolerances(checks, margin):
    found = pictures.margin({"checks": checks})
    assert found == (None if margin is None else pytest.approx(margin))
    if margin is not None:
        assert (found > 1.0) == (not all(one["passed"] for one in checks))


def test_bars_of_the_record_tell_failed_cases():
    record = read_record(ROOT / "docs" / "data" / "validation.json")
    axes = pictures.draw_cases(record).axes
    assert sorted(label.get_text() for part in axes for label in part.get_yticklabels()) == sorted(record)
    texts = [text.get_text() for part in axes for text in part.texts]
    assert len(texts) == sum(not case["passed"] for case in record.values())


def test_panels_show_expected_and_obtained_values_with_their_tolerance():
    checks = [check(2.0 * x, 2.1 * x, 0.1, f"Cp at {x}") for x in (9.0, 3.0, 5.0)]
    record = {"a": {"checks": [*checks, check(1.0, 1.0, 0.1, "Ct at 3")]}}
    ((title, data),) = pictures.panels([("a", r"^Cp at ([\d.]+)$", "power", "x", "Cp")], {}, record)
    assert title == "power"
    assert data["curves"][0]["x"] == data["curves"][1]["x"] == [3.0, 5.0, 9.0]
    assert data["curves"][0]["y"] == pytest.approx([6.0, 10.0, 18.0])
    assert data["curves"][1]["y"] == pytest.approx([6.3, 10.5, 18.9])
    assert data["band"] == pytest.approx([0.6, 1.0, 1.8])
    axes = pictures.draw_panels([(title, data)]).axes[0]
    assert [line.get_label() for line in axes.lines] == ["published", "simulator"]


def test_curves_are_few_points_and_keep_their_ends():
    time = np.linspace(0.0, 10.0, 5001)
    result = CaseResult(
        [], {"a": CaseFigure((Curve(time, np.sin(time), "sine", "o"),), "time [s]", "x [m]"), "b": print}
    )
    stored = pictures.curves_of(result)
    assert list(stored) == ["a"]
    (curve,) = stored["a"]["curves"]
    assert len(curve["x"]) == len(curve["y"]) == pictures.MOST_POINTS
    assert (curve["x"][0], curve["x"][-1]) == (0.0, 10.0)
    assert pictures.look("o", 0, over_time=True)["marker"] is None  # markers of a time series hide each other
    assert pictures.look("o", 0)["linestyle"] == "none"

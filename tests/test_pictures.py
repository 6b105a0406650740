"""What pictures say: colours and legends by closed form, places of labels, names of files."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from support import torus_scene, two_cubes
from support.shapes import cube, flipped, plate, write_off

from glvis.common.palette import SEEN_COLOR, UNSEEN_COLOR, overlap_colors, sensor_colors
from glvis.evaluation.evaluator import Evaluator
from glvis.pictures.bars import Bar, ramp_colors
from glvis.pictures.coloring import (
    KINDS,
    STRIPED,
    Coloring,
    Seen,
    Swatch,
    coloring,
    seen_by_one,
    share,
)
from glvis.pictures.framing import View
from glvis.pictures.glyphs import frustum_corners, sensor_bodies, sensor_lines
from glvis.pictures.places import (
    Box,
    grid,
    halves,
    label_places,
    length_words,
    number,
    readable,
    round_length,
    ticks,
)
from glvis.pictures.plots import write_convergence
from glvis.pictures.scenesheets import neutral_rows, perspective_sheet, subtitle
from glvis.pictures.sheet import Sheet
from glvis.pictures.stage import Stage, extreme_points
from glvis.pictures.writing import write_views
from glvis.problem.camera import look_along
from glvis.problem.lens import Pinhole
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.reports.report import page_data
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study
from glvis.viewer.packing import packed
from glvis.visibility.visibility_map import VisibilityMap

CAM = Sensor("cam", Pinhole.from_degrees(60, 40), (320, 200), 2.0, 9.0, math.radians(70))


def seen_plate(visible, positions=((0, 0, 5), (3, 0, 4)), by_axis=False) -> Seen:
    """A plate of two faces under cameras that look down."""
    visible = np.array(visible, dtype=bool)
    poses = look_along(np.array(positions[: len(visible)], float), (0, 0, -1), up=(0, 1, 0))
    model = Model.from_arrays("plate", *plate(6, 6))
    names = tuple("PQRSTUVW"[: len(visible)])
    return Seen(
        model, VisibilityMap("plate", names, visible), (CAM,) * len(visible), poses, "mm", by_axis
    )


# -- colours


def test_face_takes_the_colour_of_the_sensor_that_sees_it_most_squarely():
    seen = seen_plate([[1, 1], [1, 1]])
    # centroids at (1, -1, 0) and (-1, 1, 0): P stands over the middle, Q over (3, 0)
    incidence = [math.atan2(math.hypot(1, 1), 5), math.atan2(math.hypot(2, 1), 4)]
    assert seen.incidence(0)[0] == pytest.approx(incidence[0])
    assert seen.incidence(1)[0] == pytest.approx(incidence[1])
    colors = coloring("sensor", seen).colors
    assert (colors[:, :3] == sensor_colors(2)[0]).all()
    only_q = coloring("sensor", seen_plate([[0, 1], [1, 1]])).colors
    assert (only_q[0, :3] == sensor_colors(2)[1]).all()


def test_incidence_by_the_axis_is_the_same_for_all_faces_of_a_plate():
    np.testing.assert_allclose(seen_plate([[1, 1]], by_axis=True).incidence(0), 0, atol=1e-7)


def test_depth_is_measured_along_the_axis():
    np.testing.assert_allclose(seen_plate([[1, 1], [1, 1]]).depth(1), 4)


@pytest.mark.parametrize("kind", KINDS)
def test_unseen_faces_are_loud_and_striped_in_every_colouring(kind):
    painted = coloring(kind, seen_plate([[1, 0], [1, 0]]))
    assert painted.colors[1].tolist() == [*UNSEEN_COLOR, STRIPED]
    assert painted.colors[0, 3] == 255
    row = next(row for row in painted.swatches if row.is_striped)
    assert (row.label, row.value) == ("no sensor", "50.0\u00a0%")


def test_legend_of_sensors_names_each_with_the_share_it_sees():
    painted = coloring("sensor", seen_plate([[1, 0], [1, 1]]))
    rows = [(row.label, row.value) for row in painted.swatches]
    assert rows == [("P", "50.0\u00a0%"), ("Q", "100.0\u00a0%"), ("no sensor", "0.0\u00a0%")]
    assert "most squarely" in painted.note


def test_legend_of_overlap_counts_every_face_once():
    visible = np.zeros((4, 2))
    visible[:3, 0] = 1
    painted = coloring("overlap", seen_plate(visible, [(0, 0, 5)] * 4))
    values = [float(row.value.split("\u00a0")[0]) for row in painted.swatches]
    assert sum(values) == pytest.approx(100)
    assert [row.label for row in painted.swatches][-1] == "3 sensors"
    assert (painted.colors[0, :3] == overlap_colors(3)[3]).all()


def test_a_count_of_sensors_has_one_colour_on_all_models_and_on_the_page(tmp_path, monkeypatch):
    eye = '[[mount]]\nname = "E{}"\nsensor = "eye"\nposition = [0, 0, 4]\naim = [0, 0, 0]\n'
    text = two_cubes.SMALL.split("[[mount]]")[0] + "".join(map(eye.format, range(8)))
    placement = evaluate_poses(load_study(two_cubes.write_two_cubes(tmp_path, text)))
    of_all, of_two = placement.maps  # the two that face the sensors are seen by all, or by 2
    of_two = replace(of_two, visible=of_two.visible & (np.arange(8) < 2)[:, None])
    used = []
    monkeypatch.setattr(
        "glvis.pictures.writing.coloring",
        lambda kind, seen: used.append((seen.map.counts, coloring(kind, seen))) or used[-1][1],
    )
    maps, poses = [of_all, of_two], placement.camera_to_world
    write_views(placement.study, poses, maps, tmp_path, size=(240, 200), color="overlap")
    (header, _) = packed(page_data(replace(placement, maps=tuple(maps))))
    assert [int(counts.max()) for counts, _ in used] == [8, 2]
    for counts, painted in used:
        assert np.array_equal(painted.colors[:, :3], np.array(header["colors"]["overlap"])[counts])
    assert not np.array_equal(overlap_colors(8)[2], overlap_colors(2)[2])


def test_more_sensors_than_a_legend_has_rows_for_are_summed_up():
    n = 50
    model = Model.from_arrays("plate", *plate())
    poses = np.tile(np.eye(4), (n, 1, 1))
    names = tuple(f"S{k}" for k in range(n))
    seen = Seen(model, VisibilityMap("p", names, np.ones((n, 2), bool)), (CAM,) * n, poses, "mm")
    sensors, overlap = coloring("sensor", seen), coloring("overlap", seen)
    assert sensors.swatches[-2].label == "and 15 more"
    assert len(sensors.swatches) == 37
    assert overlap.swatches[-1].label == "35 sensors or more"
    assert overlap.swatches[-1].value == "100.0\u00a0%"


def test_heat_maps_put_the_ends_of_the_ramp_at_the_ends_of_the_bar():
    bar = coloring("distance", seen_plate([[1, 1]])).bar
    assert (bar.low, bar.high, bar.unit) == (2.0, 9.0, "mm")
    assert coloring("incidence", seen_plate([[1, 1]])).bar.high == pytest.approx(70)
    ends = ramp_colors(np.array([-1.0, 2.0, 9.0, 99.0]), 2.0, 9.0)
    assert (ends[0] == ends[1]).all()
    assert (ends[2] == ends[3]).all()
    light = ramp_colors(np.linspace(0, 1, 9), 0.0, 1.0) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light) < 0).all()  # the order survives without hue


def test_view_through_one_sensor_tells_seen_from_refused():
    painted = seen_by_one(seen_plate([[1, 0], [0, 1]]), 1, sensor_colors(2))
    assert (painted.colors[1, :3] == sensor_colors(2)[1]).all()
    assert (painted.colors[0, :3] == SEEN_COLOR).all()
    assert "nearer than 2\u00a0mm" in painted.note


def test_shares_are_of_the_area_where_the_objective_is(ring):
    study, poses, maps = ring
    by_faces, by_area = (
        replace(study, objective=replace(study.objective, by_area=which)) for which in (False, True)
    )
    visible = np.zeros_like(maps[0].visible)
    areas = study.models[0].areas
    visible[0, np.argsort(areas)[len(areas) // 2 :]] = True  # the larger half
    area = 100 * areas[visible[0]].sum() / areas.sum()
    assert area > 52
    for one, expected, whole in ((by_faces, 50.0, "2,304 faces"), (by_area, area, "the area")):
        with Stage(one, poses) as stage:
            seen = stage.show(0, replace(maps[0], visible=visible))
            text = subtitle(stage).replace("\u00a0", " ")
        assert f"{expected:.1f} % of {whole} seen by at least one of 3 sensors" in text
        values = [row.value for row in coloring("unseen", seen).swatches]
        assert values[1] == share(expected / 100)
        assert coloring("unseen", seen).heading == ("area" if one is by_area else "faces")


def test_counts_have_their_thousands_parted_everywhere(ring):
    study, poses, maps = ring
    with Stage(study, poses) as stage:
        seen = stage.show(0, maps[0])
    assert "of 2,304 faces" in coloring("unseen", seen).note


def test_legend_names_backs_only_where_one_is_drawn(tmp_path):
    write_off(tmp_path / "ring.off", plate(200, 200))
    write_off(tmp_path / "pad.off", plate(1, 1, center=(0, 0, -90)))
    (tmp_path / "ring.toml").write_text(torus_scene.STUDY)
    study = load_study(tmp_path / "ring.toml")
    found = VisibilityMap("ring", study.sensor_names, np.ones((3, 2), bool))
    listed = []
    with Stage(study, torus_scene.start_poses(study)) as stage:
        seen = stage.show(0, found)
        stage.paint(coloring("sensor", seen).colors)
        for elevation in (40.0, -40.0):
            stage.shows_backs = False
            view = View("perspective", 30.0, elevation, is_parallel=False)
            stage.picture(stage.eye(view, (160, 100), with_rig=False), (160, 100))
            listed.append([row.label for row in neutral_rows(stage)])
    assert listed == [["obstacle"], ["back of a face", "obstacle"]]


def test_room_is_looked_into_through_the_backs_of_its_walls(tmp_path):
    room = flipped(cube(400.0))
    write_off(tmp_path / "ring.off", room)
    write_off(tmp_path / "pad.off", cube(1.0))
    inside = torus_scene.STUDY.replace("260, -180, 160", "60, -80, 60").replace(
        "-300, -60, 120", "-90, -60, 20"
    )
    (tmp_path / "ring.toml").write_text(inside)
    study = load_study(tmp_path / "ring.toml")
    found = VisibilityMap("ring", study.sensor_names, np.ones((3, 12), bool))
    with Stage(study, torus_scene.start_poses(study)) as stage:
        assert stage.is_room
        painted = coloring("overlap", stage.show(0, found))
        stage.paint(painted.colors)
        sheet = perspective_sheet(stage, painted, (640, 400)).pixels().astype(int)
        assert [row.label for row in neutral_rows(stage)] == ["obstacle"]
    middle = sheet[100:300, 100:400]
    assert np.mean(np.ptp(middle, axis=2) > 25) > 0.5  # its walls from within, not grey backs


def test_unknown_colouring_is_refused():
    with pytest.raises(ValueError, match="color = 'rainbow' must be one of sensor, overlap"):
        coloring("rainbow", seen_plate([[1, 1]]))


def test_share_never_rounds_something_to_nothing_or_to_all():
    texts = [share(x).replace("\u00a0", " ") for x in (0, 1e-5, 0.1234, 0.99999, 1)]
    assert texts == ["0.0 %", "< 0.1 %", "12.3 %", "> 99.9 %", "100.0 %"]


# -- places and numbers


def test_ticks_are_round_and_hold_both_ends():
    assert ticks(160, 350) == [160, 200, 250, 300, 350]
    assert ticks(0, 70) == [0, 20, 40, 60, 70]


@pytest.mark.parametrize(
    ("longest", "length"), [(1, 1), (99, 50), (0.0031, 0.002), (2000, 2000), (4.99, 2)]
)
def test_scale_bar_has_a_round_length_that_fits(longest, length):
    assert round_length(longest) == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (999, "999"),
        (1234, "1,234"),
        (-12345.5, "−12,345.5"),
        (3e6, "3,000,000"),
        (-0.5, "−0.5"),
        (1e-5, "0.00001"),
        (2e-9, "2e−09"),
    ],
)
def test_numbers_are_written_for_people(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (200, "mm", "200 mm"),
        (2, "in", "2 inches"),
        (1, "in", "1 inch"),
        (0.5, "inch", "0.5 inches"),
    ],
)
def test_inches_are_no_preposition(value, unit, text):
    assert length_words(value, unit).replace("\u00a0", " ") == text


def test_grid_fills_its_box():
    cells = grid(Box(10, 20, 210, 110), 2, 2, 10)
    assert cells[0] == Box(10, 20, 100, 50)
    assert (cells[-1].right, cells[-1].bottom) == (220, 130)


@pytest.mark.parametrize("seed", range(10))
def test_labels_stay_inside_and_off_each_other(seed):
    rng = np.random.default_rng(seed)
    places = rng.uniform([20, 20], [580, 380], size=(8, 2))
    centres = label_places(places, [(40.0, 16.0)] * 8, 6.0, (600, 400))
    assert len(centres) == 8
    for k, c in centres.items():
        assert (c >= [20, 8]).all()
        assert (c <= [580, 392]).all()
        for other, d in centres.items():
            apart = np.abs(c - d)
            assert other == k or apart[0] >= 39.9 or apart[1] >= 15.9


def test_places_outside_get_no_label():
    places = np.array([[-5, 5], [np.nan, 5], [50, 50]], dtype=float)
    assert list(label_places(places, [(10.0, 10.0)] * 3, 4.0, (100, 100))) == [2]


def test_text_colours_are_dark_enough_for_white():
    for color in sensor_colors(16):
        assert np.array(readable(color)) @ [0.2126, 0.7152, 0.0722] < 0.42 * 255


# -- glyphs


def test_axis_ends_at_what_the_sensor_aims_at_and_the_frustum_long_before():
    pose = look_along([1, 2, 3], [0, 1, 0])[None]
    aims = np.array([8.0])
    made = sensor_lines(pose, [CAM], sensor_colors(1), 0.5, aims, with_frusta=True)
    ends, colors, widths = made
    assert ends.shape == (len(widths), 2, 3)
    assert colors.shape == (len(widths), 4)
    points = ends.reshape(-1, 3) - [1, 2, 3]
    depth = points[:, 1]  # the camera looks along +y
    assert depth.max() == pytest.approx(8.0)
    frustum = points[np.abs(points[:, 0]) > 0.45]  # beyond the glyph
    length = frustum[:, 1].max()
    assert length < 0.5 * 8.0
    far = frustum[np.isclose(frustum[:, 1], length)]
    tan = CAM.lens.tan_half
    np.testing.assert_allclose(np.abs(far[:, 0]), tan[0] * length)
    np.testing.assert_allclose(np.abs(far[:, 2]), tan[1] * length)
    corners = frustum_corners(pose, [CAM], 0.5, aims)[0] - [1, 2, 3]
    np.testing.assert_allclose(corners[:, 1], length)
    without = sensor_lines(pose, [CAM], sensor_colors(1), 0.5, aims, with_frusta=False)[0]
    assert len(without) < len(ends)


@pytest.mark.parametrize("aim", [20.0, np.inf])
def test_no_line_is_longer_than_the_sensor_reaches(aim):
    pose = look_along([0, 0, 0], [0, 1, 0])[None]
    made = sensor_lines(pose, [CAM], sensor_colors(1), 0.5, np.array([aim]), with_frusta=True)
    assert made[0][..., 1].max() <= CAM.max_distance + 1e-9


def test_sensors_aim_at_the_first_surface_on_their_axis(ring):
    study, poses, maps = ring
    with Stage(study, poses) as stage:
        stage.show(0, maps[0])
        aims = stage.aims()
    # A looks at the ring's near or far side: a torus of radii 80 and 28 about the origin
    points = poses[:, :3, 3] - aims[:, None] * poses[:, :3, 2]
    hit = np.isfinite(aims)
    assert hit.any()
    for x, y, z in points[hit]:
        on_torus = math.hypot(math.hypot(x, y) - 80, z)
        on_pad = abs(z + 40) < 1.5 and max(abs(x), abs(y)) < 72
        assert on_pad or on_torus == pytest.approx(28, abs=2.0)


def test_frusta_end_inside_the_picture(ring):
    study, poses, maps = ring
    with Stage(study, poses) as stage:
        stage.show(0, maps[0])
        ends = frustum_corners(poses, study.sensors, stage.body_size, stage.aims())
        corners = np.concatenate(ends)
        for view in stage.views().values():
            eye = stage.eye(view, (320, 200), with_rig=True)
            pixels = eye.project(corners, (320, 200))
            assert ((pixels >= 0) & (pixels <= [320, 200])).all()


def test_model_fills_a_panel_of_its_own_where_sensors_stand_far_off(ring):
    study, poses, maps = ring
    sizes = []
    for far in (1.0, 4.0):
        moved = poses.copy()
        moved[:, :3, 3] *= far
        with Stage(study, moved) as stage:
            painted = coloring("sensor", stage.show(0, maps[0]))
            stage.paint(painted.colors)
            picture = perspective_sheet(stage, painted, (640, 400)).pixels().astype(int)
        panels = picture[45:340, :480]
        sizes.append(np.mean(np.ptp(panels, axis=2) > 40))
    assert sizes[1] > 0.6 * sizes[0]  # colour on the sheet: the ring is as large as before


def test_halves_share_a_box():
    first, second = halves(Box(10, 20, 210, 110), 0.4, 10, stacked=False)
    assert (first.x, first.width, second.x, second.right) == (10, 80, 100, 220)
    first, second = halves(Box(10, 20, 210, 110), 0.5, 10, stacked=True)
    assert (first.y, first.height, second.y, second.bottom) == (20, 50, 80, 130)


def test_bodies_are_closed_wind_outward_and_point_where_the_sensor_looks():
    pose = look_along([0, 0, 0], [1, 0, 0])[None]
    vertices, faces, colors = sensor_bodies(pose, [CAM], sensor_colors(1), 2.0)
    assert len(colors) == len(faces)
    model = Model.from_arrays("body", vertices, faces)
    assert model.is_consistent
    volume = np.sum(np.sum(model.centroids * model.normals, axis=1) * model.areas) / 3
    assert volume > 0
    assert vertices[:, 0].max() > 0  # the image plane lies ahead
    assert vertices[:, 0].min() < 0  # the box behind


# -- sheets


def ink(sheet: Sheet) -> np.ndarray:
    return (sheet.pixels() != 255).any(axis=2)


def test_legend_draws_chips_values_and_bar_inside_its_column():
    sheet = Sheet((800, 500), unit=0.5)
    rows = [Swatch(np.array([200, 0, 0], np.uint8), "one", "12 %"), Swatch(UNSEEN_COLOR, "two")]
    painted = Coloring("t", np.zeros((0, 4), np.uint8), rows, Bar(0, 5, "depth", "mm"), "A note.")
    box = Box(500, 50, 150, 400)
    sheet.legend(box, painted)
    picture, marks = sheet.pixels(), ink(sheet)
    assert (picture == [200, 0, 0]).all(axis=2).sum() > 50
    bar = ramp_colors(np.array([0.0]), 0, 5)[0]
    assert (picture == bar).all(axis=2).any()
    assert not marks[:, :498].any()
    assert not marks[:, 652:].any()


def test_text_is_broken_between_words_and_never_at_hard_spaces():
    sheet = Sheet((400, 400), unit=1.0)
    lines = sheet.wrapped("alpha beta 20\u00a0% gamma", sheet.text_width("alpha beta 20", 15), 15)
    assert lines == ["alpha beta", "20\u00a0% gamma"]


def test_line_breaks_in_names_are_blanks(ring):
    sheet = Sheet((300, 100), unit=1.0)
    assert sheet.text_width("two\nlines\x07") == sheet.text_width("two lines ")
    sheet.heading("two\nlines", "sub\ttitle\r")
    assert ink(sheet).any()


def test_money_in_a_title_is_no_formula(tmp_path):
    pictures = []
    for title in ("from 5 to 7 $", "from $5 to 7 $", "from $\\frac{5$ to 7"):
        options = {"title": title, "quantity": "OF3", "size": (320, 200)}
        write_convergence(tmp_path / "c.png", trace(), **options)
        pictures.append(np.array(Image.open(tmp_path / "c.png")))
    assert (pictures[0] != pictures[1]).any()


def test_long_titles_are_cut_with_an_ellipsis():
    sheet = Sheet((400, 400), unit=1.0)
    short = sheet.shortened("word " * 50, 200, 18)
    assert short.endswith("…")
    assert sheet.text_width(short, 18) <= 200
    assert sheet.shortened("word", 200, 18) == "word"


def test_scale_bar_is_as_long_as_it_says():
    sheet = Sheet((400, 100), unit=1.0)
    sheet.scale_bar(380, 60, pixels_per_length=3.0, room=100, unit="mm")
    row = ink(sheet)[61]
    assert row.sum() == pytest.approx(60, abs=2)  # 20 mm is the largest round length in 33


def test_triad_points_where_the_axes_do():
    sheet = Sheet((200, 200), unit=1.0)
    sheet.triad(100, 100, 60, np.eye(3))
    red = np.argwhere(np.abs(sheet.pixels().astype(int) - [196, 42, 42]).max(axis=2) < 20)
    green = np.argwhere(np.abs(sheet.pixels().astype(int) - [42, 128, 42]).max(axis=2) < 20)
    assert np.ptp(red[:, 1]) > np.ptp(red[:, 0])  # X to the right
    assert np.ptp(green[:, 0]) > np.ptp(green[:, 1])  # Y upwards
    assert green[:, 0].min() < red[:, 0].min()


# -- the stage


def test_extreme_points_reach_as_far_as_all_of_them(rng):
    points = rng.normal(size=(30_000, 3))
    few = extreme_points(points)
    assert len(few) < 500
    for direction in np.eye(3):
        assert (few @ direction).max() > 0.97 * (points @ direction).max()


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    study = torus_scene.ring_study(tmp_path_factory.mktemp("ring"))
    with Evaluator(study) as evaluator:
        maps = evaluator.visibility(np.zeros(0))
    return study, torus_scene.start_poses(study), maps


def test_other_side_of_a_closed_body_is_opposite_and_of_a_room_is_not(ring, tmp_path):
    study, poses, maps = ring
    with Stage(study, poses) as stage:
        stage.show(0, maps[0])
        first = stage.views()["perspective"]
        other = stage.other_side(first)
    assert (other.azimuth_deg - first.azimuth_deg) % 360 == 180
    assert other.elevation_deg == -first.elevation_deg


def test_sensor_eye_projects_as_the_sensor_does(ring):
    study, poses, maps = ring
    with Stage(study, poses) as stage:
        stage.show(0, maps[0])
        eye = stage.sensor_eye(2)
    tan = study.sensors[2].lens.tan_half
    corner = poses[2] @ [tan[0] * 7, tan[1] * 7, -7, 1]
    np.testing.assert_allclose(eye.project(corner[:3], (320, 240)), [320, 0], atol=1e-6)


@pytest.mark.parametrize("name", ["top", "perspective"])
def test_what_stands_behind_the_scene_is_known_to_be_hidden(ring, name):
    study, poses, maps = ring
    with Stage(study, poses) as stage:
        stage.show(0, maps[0])
        view = stage.views()[name]
        eye = stage.eye(view, (320, 200), with_rig=True)
        pad, seat = np.array([0, 0, -50]), eye.camera_to_world[:3, 3]
        away = 40 * (seat - pad) / np.linalg.norm(seat - pad)
        points = np.array([pad - away, seat - away, seat + away, [900, 900, -50]])
        hidden = stage.is_hidden(points, eye, (320, 200))
    assert hidden.tolist() == [True, False, False, False]


# -- the files


def trace(n=30):
    return [
        SimpleNamespace(best=14 - 5 * 0.9**k, mean=12 - 6 * 0.9**k, evaluations=50 * (k + 1))
        for k in range(n)
    ]


def test_all_pictures_are_written_with_names_one_can_guess(ring, tmp_path):
    study, poses, maps = ring
    paths = write_views(study, poses, maps, tmp_path, trace=trace(), size=(320, 240))
    scene = ["sensor-perspective", "sensor-sides", "overlap-perspective", "overlap-sides"]
    expected = {f"ring-{name}.png" for name in (*scene, *KINDS[2:], "contact")}
    expected |= {f"sensor-{s}{end}.png" for s in "ABC" for end in ("", "-depth")}
    expected.add("convergence.png")
    assert {path.name for path in paths} == expected
    assert {path.name for path in tmp_path.iterdir()} == expected
    for path in paths:
        with Image.open(path) as picture:
            own_shape = path.stem.startswith("sensor-") or path.stem.endswith("contact")
            assert picture.size[0] <= 320 if own_shape else picture.size == (320, 240)
            picture.verify()


def test_only_the_wanted_colouring_is_written_and_the_view_changes_it(ring, tmp_path):
    study, poses, maps = ring
    pictures = []
    for k, view in enumerate((None, (200.0, 10.0))):
        folder = tmp_path / str(k)
        folder.mkdir()
        paths = write_views(
            study, poses, maps, folder, size=(320, 240), color="unseen", view=view, trace=trace()
        )
        assert [path.name for path in paths] == ["ring-unseen.png"]
        pictures.append(np.array(Image.open(paths[0])).astype(int))
    assert np.abs(pictures[0] - pictures[1]).max() > 100


def test_pictures_are_the_same_each_time(ring, tmp_path):
    study, poses, maps = ring
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_views(study, poses, maps, tmp_path / name, size=(240, 200), color="overlap")
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_names_that_no_file_can_have_are_changed_and_kept_apart(ring, tmp_path):
    study, poses, maps = ring
    text = torus_scene.STUDY.replace('"A"', '"a b"').replace('"B"', '"a_b"')
    study = torus_scene.ring_study(tmp_path, text)
    renamed = [VisibilityMap("ring", study.sensor_names, maps[0].visible)]
    out = tmp_path / "views"
    out.mkdir()
    names = {p.name for p in write_views(study, poses, renamed, out, size=(200, 200))}
    assert {"sensor-a_b.png", "sensor-a_b_.png"} <= names


def test_bad_requests_are_refused(ring, tmp_path):
    study, poses, maps = ring
    with pytest.raises(ValueError, match="color = 'depth' must be one of"):
        write_views(study, poses, maps, tmp_path, color="depth")
    with pytest.raises(ValueError, match="1 models need as many maps, got 2"):
        write_views(study, poses, [*maps, *maps], tmp_path)
    with pytest.raises(ValueError, match="size = 100 x 900 must be at least 200 x 200 pixels"):
        write_views(study, poses, maps, tmp_path, size=(100, 900))
    assert not list(tmp_path.iterdir())


def test_convergence_plot_holds_both_curves(tmp_path):
    path = tmp_path / "c.png"
    options = {"title": "t", "quantity": "OF3", "size": (640, 400)}
    write_convergence(path, trace(), start_value=9.0, upper_bound=15.0, **options)
    picture = np.array(Image.open(path).convert("RGB")).astype(int)
    assert picture.shape == (400, 640, 3)
    for color in ((0, 114, 178), (213, 94, 0)):
        assert (np.abs(picture - color).max(axis=2) < 12).sum() > 100


def test_convergence_plot_survives_values_that_are_not_finite(tmp_path):
    rows = [SimpleNamespace(best=-math.inf, mean=math.nan, evaluations=1), *trace(3)]
    write_convergence(tmp_path / "c.png", rows, title="", quantity="v", size=(320, 200))
    assert (tmp_path / "c.png").stat().st_size > 1000


def test_search_without_steps_has_no_plot(tmp_path):
    with pytest.raises(ValueError, match="a search without steps cannot be plotted"):
        write_convergence(tmp_path / "c.png", [], title="", quantity="")

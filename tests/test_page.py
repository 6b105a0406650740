"""The page: what is written, and what a browser makes of it.

The browser tests look at a plate of known triangles and compare with NumPy; they are skipped
where there is no Chromium.
"""

import dataclasses
import json
import logging
import re

import numpy as np
import pytest

from glvis.common.palette import UNSEEN_COLOR, sensor_colors
from glvis.problem.camera import look_along, projection_matrix, rigid_inverse
from glvis.problem.lens import Pinhole
from glvis.problem.scene import Model, load_model
from glvis.problem.visibility_options import VisibilityOptions
from glvis.viewer.page import page_text, write_page
from glvis.viewer.page_data import (
    PageData,
    PageModel,
    PageObstacle,
    PageSensor,
    PageTable,
    PageTrace,
)
from glvis.visibility.filters import Limits, faces_in_camera, refusal

N = 12  # cells along the plate
SIZE = 120.0
CORNER = np.array([1000.0, -500.0, 40.0])  # the plate lies far from the world's origin
HALF = np.array([SIZE / 2, SIZE / 2, 0])  # from the corner to the plate's middle
SIZE_OF_PAGE = (900, 560)
TAN = Pinhole.from_degrees(60, 40).tan_half
NASTY = "Plate </script><b>&amp; \u2028"


def plate(bump=0.0):
    """A wavy square that faces +z: vertices ((N + 1)^2, 3), faces (2 N^2, 3)."""
    i, j = np.meshgrid(np.arange(N + 1), np.arange(N + 1), indexing="ij")
    z = bump * np.sin(i) * np.cos(j)
    vertices = np.stack([i * SIZE / N, j * SIZE / N, z], axis=-1).reshape(-1, 3) + CORNER
    a = (i[:-1, :-1] * (N + 1) + j[:-1, :-1]).ravel()
    b, c, d = a + N + 1, a + N + 2, a + 1
    return vertices, np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


def box():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[0], q[k], q[k + 1]] for q in quads for k in (1, 2)]
    return CORNER + [150, 40, 0] + 30 * corners, np.array(faces)


def example(**changes):
    """Two sensors over two plates: A sees x below half, B sees y below half."""
    vertices, faces = plate()
    wavy, _ = plate(bump=6.0)
    x, y, _ = (vertices[faces].mean(axis=1) - CORNER).T / SIZE
    visible = np.stack([x < 0.5, y < 0.5])
    middle = CORNER + HALF
    poses = [
        look_along(middle + at, -np.array(at), roll)
        for at, roll in (([30.0, -20.0, 260.0], 0.3), ([-40.0, 150.0, 220.0], -0.2))
    ]
    data = {
        "title": NASTY,
        "unit": "mm",
        "up": (0, 0, 1),
        "models": [PageModel("flat", vertices, faces, visible),
                   PageModel("wavy", wavy, faces, ~visible)],
        "sensors": [PageSensor(name, "cam", pose, TAN, 100, 400, np.radians(70), (640, 480))
                    for name, pose in zip("AB", poses, strict=True)],
        "obstacles": [PageObstacle("post", *box())],
        "tables": [PageTable("Coverage", ("Model", "Faces", "Share"),
                             [(NASTY, 288, np.nan), ("wavy", 1288, 75.5)])],
        "trace": PageTrace(np.arange(5), [1.0, 2, 3, 3, 4], [np.nan, 1, 1, 2, np.inf]),
        "facts": [("Seed", "1"), ("Driver", NASTY)],
        "mounting": ["A: on the ceiling", "  turn it left"],
    }  # fmt: skip
    return PageData(**(data | changes))


def header(text):
    """Return the study that the page carries."""
    return json.loads(re.search(r'id="study">(.*?)</script>', text, re.S).group(1))


# ---- the file


def test_page_refers_to_nothing_outside_itself():
    text = page_text(example())
    outside = set(re.findall(r"https?://[^\"'\s)]+", text)) - {"http://www.w3.org/2000/svg"}
    assert not outside
    assert not re.findall(r"(?:src|href)=\"(?!data:)", text)
    assert "default-src 'none'" in text


def test_text_of_the_user_cannot_end_the_script():
    text = page_text(example())
    assert text.count("</script>") == 3
    assert header(text)["title"] == NASTY


def test_numbers_that_json_lacks_become_empty():
    study = header(page_text(example()))
    assert study["trace"]["mean"] == [None, 1, 1, 2, None]
    assert study["tables"][0]["rows"][0][2] is None


def test_hundred_thousand_faces_in_any_order_stay_below_four_megabytes(rng):
    # Ten times that is the million faces that must fit in 40 MB.
    vertices, faces = rng.normal(size=(50_000, 3)), rng.integers(0, 50_000, (100_000, 3))
    visible = rng.random((2, len(faces))) < 0.5
    assert len(page_text(example(models=[PageModel("dust", vertices, faces, visible)]))) < 4e6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"models": []}, "a page needs at least one model"),
        ({"models": [PageModel("m", *plate(), np.zeros((2, 5)))]},
         r"the map of 'm' must have shape \(2, 288\), got \(2, 5\)"),
        ({"obstacles": [PageObstacle("o", np.zeros((3, 3)), np.zeros((0, 3)))]},
         r"faces of 'o' must have shape \(F, 3\), got \(0, 3\)"),
        ({"obstacles": [PageObstacle("o", np.zeros((3, 3)), [[0, 1, 3]])]},
         "faces of 'o' must index its 3 vertices"),
        ({"tables": [PageTable("T", ("a", "b"), [("x",)])]},
         "table 'T' has 2 columns, a row has 1"),
    ],
)  # fmt: skip
def test_wrong_shapes_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        page_text(example(**change))


# ---- in the browser


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("a folder") / "report.html"
    write_page(path, example())
    return path


@pytest.fixture(scope="module")
def opened(browser, page):
    """The example, opened once."""
    browser.open(page, SIZE_OF_PAGE)
    return browser


@pytest.fixture
def tab(opened, page):
    """The example as it opens; the test fails if the console says anything."""
    opened.errors.clear()
    if not opened.run("location.href").endswith(page.name):
        opened.open(page, SIZE_OF_PAGE)
    opened.run(
        "glvis.leaveSensor(0); glvis.state.on.fill(true); glvis.state.kept = -1;"
        "for (const [name, on] of Object.entries({frusta: true, obstacles: true, labels: true,"
        " edges: false, cut: false})) glvis.show(name, on);"
        "glvis.setMode('sensor'); glvis.setModel(0); glvis.setView('3D', 0);"
        "document.getElementById('keys').hidden = true"
    )
    opened.mouse("mouseMoved", 880, 550)
    opened.settle()
    yield opened
    assert opened.errors == []


def centroids(model):
    return np.asarray(model.vertices)[np.asarray(model.faces)].mean(axis=1)


def expected_pixels(tab, sensor, points):
    """CSS pixels (N, 2) of world points in the view through a sensor, by our own camera."""
    frame = tab.run("glvis.frame()")
    world_to_clip = projection_matrix(sensor.tan_half, 1, 1000) @ rigid_inverse(
        sensor.camera_to_world
    )
    clip = np.c_[points, np.ones(len(points))] @ world_to_clip.T
    ndc = clip[:, :2] / clip[:, 3:]
    return np.stack(
        [frame["left"] + (1 + ndc[:, 0]) / 2 * frame["width"],
         frame["top"] + (1 - ndc[:, 1]) / 2 * frame["height"]], axis=1)  # fmt: skip


def differs(a, b):
    """Number of pixels that look different; the compositor itself drifts a little at edges."""
    return int((np.abs(a.astype(int) - b).max(axis=-1) > 24).sum())


def test_meshes_and_maps_arrive_bit_by_bit(tab):
    data = example()
    first = np.asarray(data.models[0].vertices)
    origin = (first.min(axis=0) + first.max(axis=0)) / 2
    for i, model in enumerate(data.models):
        tab.run(f"glvis.setModel({i})")
        got = tab.run(
            "(m => ({v: [...m.vertices], f: [...m.faces],"
            " s: [0, 1].map(s => Array.from({length: m.nFaces}, (_, f) => m.sees(s, f)))}))"
            "(glvis.model())"
        )
        sent = (np.asarray(model.vertices) - origin).astype(np.float32)
        assert np.array_equal(np.reshape(got["v"], (-1, 3)).astype(np.float32), sent)
        assert np.array_equal(np.reshape(got["f"], (-1, 3)), model.faces)
        assert np.array_equal(np.array(got["s"], dtype=bool), model.visible)


def test_users_text_is_shown_as_text(tab):
    assert tab.run("document.querySelector('h1').textContent") == NASTY
    assert tab.run("document.title").startswith("Plate </script><b>&amp;")
    assert tab.run("document.querySelector('#details td').textContent") == NASTY


def test_numbers_follow_the_sensors_that_are_on(tab):
    a, b = np.asarray(example().models[0].visible)
    both = tab.run("glvis.covered()")
    assert both["exactly"] == [int((~a & ~b).sum()), int((a ^ b).sum()), int((a & b).sum())]
    assert both["seen"] == [int(a.sum()), int(b.sum())]
    assert both["alone"] == [int((a & ~b).sum()), int((b & ~a).sum())]
    tab.run("glvis.setSensor(0, false)")
    assert tab.run("glvis.covered().exactly") == [int((~b).sum()), int(b.sum()), 0]
    assert "50 %" in tab.run("document.getElementById('stats').textContent").replace("50.0", "50")


def test_coarse_model_in_motion_is_made_of_the_same_vertices_and_faces(tab):
    data = example()
    got = tab.run(
        "(m => ({faces: [...m.faces], origin: [...m.origin]}))(glvis.coarsened(glvis.model(), 4))"
    )
    faces, origin = np.reshape(got["faces"], (-1, 3)), np.array(got["origin"])
    assert 8 <= len(faces) < len(data.models[0].faces) / 2
    vertices = np.asarray(data.models[0].vertices)
    moved = np.abs(vertices[faces] - vertices[np.asarray(data.models[0].faces)[origin]])
    assert moved.max() <= SIZE / 4  # no corner leaves its cell
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area > 0.5 * SIZE**2


def test_the_one_gap_is_found_where_it_is(tab):
    model = example().models[0]
    unseen = ~np.any(model.visible, axis=0)
    (gap,) = tab.run("glvis.covered().gaps")
    assert gap["nFaces"] == unseen.sum()
    assert gap["area"] == pytest.approx(unseen.sum() * (SIZE / N) ** 2 / 2, rel=1e-5)
    center = centroids(model)[unseen].mean(axis=0) - CORNER - HALF
    assert np.allclose(gap["center"], center, atol=1e-3)


@pytest.mark.parametrize("s", [0, 1])
def test_through_a_sensor_each_face_is_picked_where_its_centre_projects(tab, s):
    data = example()
    tab.run(f"glvis.lookThrough({s}, 0)")
    tab.settle()
    points = centroids(data.models[0])
    pixels = expected_pixels(tab, data.sensors[s], points)
    faces = range(0, len(points), 7)
    picked = tab.run(f"{pixels[faces].tolist()}.map(([x, y]) => glvis.pickAt(x, y))")
    assert [p["face"] for p in picked] == list(faces)
    assert {p["model"] for p in picked} == {"flat"}


def test_nothing_is_picked_beside_and_the_obstacle_by_its_name(tab):
    data = example()
    tab.run("glvis.lookThrough(0, 0)")
    tab.settle()
    top = CORNER + np.array([165, 55, 30])  # the middle of the post's upper side
    ((x, y),) = expected_pixels(tab, data.sensors[0], [top])
    assert tab.run(f"glvis.pickAt({x}, {y})") == {"kind": "obstacle", "name": "post"}
    tab.run("glvis.show('obstacles', false)")
    assert tab.run(f"glvis.pickAt({x}, {y})") is None
    assert tab.run("glvis.pickAt(-5, 3)") is None


def test_hovering_tells_distance_and_incidence_of_each_sensor(tab):
    data, face = example(), 5
    tab.run("glvis.lookThrough(0, 0)")
    tab.settle()
    point = centroids(data.models[0])[face]
    ((x, y),) = expected_pixels(tab, data.sensors[0], [point])
    tab.mouse("mouseMoved", x, y)
    tab.settle()
    text = tab.run("document.getElementById('readout').innerText")
    assert "Seen by 2 of 2" in text
    for sensor in data.sensors:
        pose = np.asarray(sensor.camera_to_world)
        depth = -(rigid_inverse(pose) @ [*point, 1])[2]
        ray = pose[:3, 3] - point
        incidence = np.degrees(np.arccos(ray[2] / np.linalg.norm(ray)))  # the plate faces +z
        assert re.search(rf"{sensor.name}\s+{depth:.1f} mm\s+{incidence:.1f}°", text)


def test_reasons_for_not_seeing_are_those_of_the_geometry(browser, tmp_path):
    vertices, faces = plate()
    middle = CORNER + HALF
    nobody = np.zeros((6, len(faces)), dtype=bool)
    cases = {
        "outside its view": ((0, 0, 250), (1, 0, 0)),
        "faces away": ((0, 0, -250), (0, 0, 1)),
        "too near": ((0, 0, 50), (0, 0, -1)),
        "too far": ((0, 0, 500), (0, 0, -1)),
        "too oblique": ((280, 0, 60), (-280, 0, -60)),
        "hidden": ((0, 0, 250), (0, 0, -1)),
    }
    sensors = [
        PageSensor(why, "cam", look_along(middle + at, d), TAN, 100, 400, np.radians(70))
        for why, (at, d) in cases.items()
    ]
    model = Model.from_arrays("flat", vertices, faces)
    options = VisibilityOptions()
    refusals = [
        refusal(
            faces_in_camera(model, one.camera_to_world, options),
            Limits(
                Pinhole.from_tangents(*one.tan_half),
                one.min_distance,
                one.max_distance,
                np.cos(np.radians(70)),
            ),
        )
        for one in sensors
    ]
    told = PageModel("flat", vertices, faces, nobody, refusals=refusals)
    data = example(models=[told, PageModel("wavy", vertices, faces, nobody)], sensors=sensors)
    here = np.abs(vertices[faces].mean(axis=1) - middle).sum(axis=1).argmin()
    path = tmp_path / "reasons.html"
    write_page(path, data)
    browser.open(path)
    readings = browser.run(f"glvis.read({here})")
    assert [r["why"] for r in readings] == list(cases)
    browser.run("glvis.setModel(1)")
    assert {r["why"] for r in browser.run(f"glvis.read({here})")} == {"not seen"}


def test_faces_have_the_color_of_their_sensor_and_unseen_ones_are_loud(tab):
    data = example()
    tab.run(
        "glvis.setView('Top', 0); Object.assign(glvis.camera().state, {target: [0, 0, 0], h: 80});"
        "for (const name of ['frusta', 'labels', 'obstacles']) glvis.show(name, false)"
    )
    image = tab.screenshot().astype(float)
    points = centroids(data.models[0])
    back = np.stack([np.asarray(s.camera_to_world)[:3, 3] for s in data.sensors])[:, None] - points
    cosine = back[..., 2] / np.linalg.norm(back, axis=-1)  # the plate faces +z
    visible = np.asarray(data.models[0].visible)
    cosine[~visible] = 0
    expected = np.where(visible.any(axis=0), cosine.argmax(axis=0), 2)
    colors = np.vstack([sensor_colors(2), UNSEEN_COLOR]).astype(float)
    colors /= np.linalg.norm(colors, axis=1, keepdims=True)
    assert set(expected) == {0, 1, 2}
    where = (points - CORNER - HALF).tolist()
    pixels = tab.run(f"{where}.map(p => glvis.camera().project(p))")
    kinds = tab.run(f"{pixels}.map(({{x, y}}) => glvis.pickAt(x, y).kind)".replace("'", '"'))
    clear = (np.abs(np.diff(cosine, axis=0)[0]) > 1e-3) | (expected == 2)
    right = []
    for face in np.flatnonzero(clear & (np.array(kinds) == "model")):  # not under a sensor's body
        x, y = int(pixels[face]["x"]), int(pixels[face]["y"])
        shown = image[y - 1 : y + 2, x - 1 : x + 2].mean(axis=(0, 1))
        right.append(np.argmax(colors @ shown) == expected[face])
    assert len(right) > 250
    assert np.mean(right) > 0.95  # the optical axes run over the others


def test_each_switch_changes_the_picture_and_back_again(tab):
    switches = {
        "setMode('overlap')": "setMode('sensor')",
        "setMode('unseen')": "setMode('sensor')",
        "setSensor(1, false)": "setSensor(1, true)",
        "show('frusta', false)": "show('frusta', true)",
        "show('obstacles', false)": "show('obstacles', true)",
        "show('labels', false)": "show('labels', true)",
        "show('edges', true)": "show('edges', false)",
        "setModel(1)": "setModel(0)",
        "setView('Side', 0)": "setView('3D', 0)",
        "lookThrough(1, 0)": "leaveSensor(0)",
    }
    stage = np.s_[:, :520]  # the picture, without the panel
    before = tab.screenshot()[stage]
    for change, back in switches.items():
        tab.run(f"glvis.{change}")
        assert differs(tab.screenshot()[stage], before) > 50, change
        tab.run(f"glvis.{back}")
        assert differs(tab.screenshot()[stage], before) == 0, back


def test_standard_views_show_the_scene_as_named(tab):
    axes = {
        view: tab.run(f"(glvis.setView('{view}', 0), glvis.camera().axes())")
        for view in ("Top", "Front", "Side")
    }
    expected = {
        "Top": ([1, 0, 0], [0, 1, 0], [0, 0, -1]),
        "Front": ([1, 0, 0], [0, 0, 1], [0, 1, 0]),
        "Side": ([0, 1, 0], [0, 0, 1], [-1, 0, 0]),
    }
    for view, wanted in expected.items():
        got = [axes[view][name] for name in ("right", "up", "direction")]
        assert np.allclose(got, wanted, atol=1e-12), view


def test_mouse_turns_moves_and_zooms(tab):
    def state():
        return tab.run("({...glvis.camera().state})")

    before = state()
    tab.mouse("mousePressed", 300, 300, button="left", buttons=1, clickCount=1)
    tab.mouse("mouseMoved", 330, 290, button="left", buttons=1)
    tab.mouse("mouseMoved", 400, 280, button="left", buttons=1)
    tab.mouse("mouseReleased", 400, 280, button="left")
    turned = state()
    assert turned["yaw"] > before["yaw"]
    assert turned["h"] == before["h"]
    tab.mouse("mousePressed", 300, 300, button="right", buttons=2, clickCount=1)
    tab.mouse("mouseMoved", 360, 300, button="right", buttons=2)
    tab.mouse("mouseReleased", 360, 300, button="right")
    moved = state()
    assert moved["yaw"] == turned["yaw"]
    assert not np.allclose(moved["target"], turned["target"])
    tab.mouse("mouseWheel", 300, 300, deltaX=0, deltaY=-200)
    tab.settle()
    assert state()["h"] < moved["h"]


def test_zooming_keeps_the_point_under_the_pointer(tab):
    kept = tab.run(
        "(() => { const c = glvis.camera(); glvis.setView('Top', 0);"
        " const p = [10, 20, 0], a = c.project(p); c.zoom(0.5, a.x, a.y);"
        " const b = c.project(p); return [a.x - b.x, a.y - b.y]; })()"
    )
    assert np.allclose(kept, 0, atol=0.01)


def test_keys_do_what_the_help_says(tab):
    tab.run("document.getElementById('canvas').focus()")
    tab.key("u")
    assert tab.run("glvis.state.mode") == "unseen"
    tab.key("]")
    assert tab.run("glvis.model().name") == "wavy"
    before = tab.run("glvis.camera().state.yaw")
    tab.key("ArrowLeft")
    assert tab.run("glvis.camera().state.yaw") != before
    tab.key("n")
    assert tab.run("glvis.state.through") == 0
    tab.key("Escape")
    assert tab.run("glvis.state.through") == -1
    tab.key("?")
    assert tab.run("!document.getElementById('keys').hidden")


def test_a_link_may_say_where_to_begin(browser, page):
    browser.errors.clear()
    browser.open(page, SIZE_OF_PAGE, fragment="#mode=unseen&model=wavy&edges=1&through=B")
    assert browser.run("[glvis.state.mode, glvis.model().name, glvis.state.edges]") == [
        "unseen",
        "wavy",
        True,
    ]
    assert browser.run("glvis.state.through") == 1
    assert browser.errors == []


def test_a_click_on_a_label_looks_through_that_sensor(tab):
    tab.settle()
    x, y = tab.run(
        "(b => [b.left + b.width / 2, b.top + b.height / 2])"
        "(document.querySelectorAll('.label')[1].getBoundingClientRect())"
    )
    tab.mouse("mousePressed", x, y, button="left", buttons=1, clickCount=1)
    tab.mouse("mouseReleased", x, y, button="left", clickCount=1)
    assert tab.run("glvis.state.through") == 1


def test_on_a_phone_nothing_overflows_and_fingers_work(browser, page):
    browser.errors.clear()
    browser.open(page, (390, 844), mobile=True, dark=True)
    assert browser.run("document.documentElement.scrollWidth") == 390
    image = browser.screenshot()
    assert image[560:, :].mean() < 100  # dark where the reader asked for dark
    browser.run("glvis.setView('Top', 0)")
    browser.settle()
    at = browser.run("glvis.camera().project([-20, -20, 0])")
    spot = {"x": at["x"], "y": at["y"]}
    browser.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[spot])
    browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    browser.settle()
    assert "Seen by 2 of 2" in browser.run("document.getElementById('readout').innerText")
    height = browser.run("glvis.camera().state.h")

    def fingers(*x):
        return [{"x": v, "y": 250, "id": i} for i, v in enumerate(x)]

    browser.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=fingers(150, 240))
    for spread in (10, 20, 30):
        browser.call("Input.dispatchTouchEvent", type="touchMove",
                     touchPoints=fingers(150 - spread, 240 + spread))  # fmt: skip
    browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    browser.settle()
    assert browser.run("glvis.camera().state.h") < 0.8 * height
    assert browser.errors == []


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ("HTMLCanvasElement.prototype.getContext = () => null", "offers no WebGL 2"),
        ("delete window.DecompressionStream", "too old to unpack the scene"),
    ],
)
def test_a_browser_that_cannot_draw_says_so_and_keeps_the_tables(browser, page, missing, message):
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=missing)
    try:
        with pytest.raises(RuntimeError, match=message):
            browser.open(page)
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", **script)
    assert message in browser.run("document.getElementById('notice').innerText")
    assert "wavy" in browser.run("document.getElementById('details').innerText")


def test_six_real_arms_make_a_page_below_three_megabytes(browser, shared_data, tmp_path):
    files = sorted((shared_data / "arms").glob("arm*.stl"))
    models = []
    for model in map(load_model, files):
        towards = np.array([[0, 1, 0], [1, -1, 0], [-1, -1, 0]]) / [[1], [2**0.5], [2**0.5]]
        visible = towards @ model.normals.T > 0.5
        models.append(PageModel(model.name, model.vertices, model.faces, visible))
    sensors = [
        PageSensor(f"S{i}", "cam", look_along(300.0 * d, -d, 0.0), TAN, 100, 400)
        for i, d in enumerate(towards)
    ]
    path = tmp_path / "arms.html"
    write_page(path, example(models=models, sensors=sensors, up=(0, 1, 0), obstacles=()))
    assert path.stat().st_size < 3e6
    browser.errors.clear()
    browser.open(path, (1600, 1000))
    faces = browser.run("glvis.model().nFaces")
    assert faces == len(models[0].faces)
    image = browser.screenshot()
    colors = sensor_colors(3).astype(float)
    stage = image[:, :1100].reshape(-1, 3).astype(float)
    length = np.linalg.norm(stage, axis=1)
    for color in colors:
        cosine = stage @ color / np.maximum(length, 1) / np.linalg.norm(color)
        assert (cosine > 0.99).sum() > 1000
    assert browser.errors == []
    logging.getLogger(__name__).info(
        "first picture of six arms after %.0f ms", browser.run("glvis.firstPicture")
    )


def test_a_page_of_one_lonely_model_shows_no_selector(browser, tmp_path):
    data = example()
    path = tmp_path / "one.html"
    lonely = dataclasses.replace(
        data, models=data.models[:1], obstacles=(), tables=(), trace=None, facts=(), mounting=()
    )
    write_page(path, lonely)
    browser.errors.clear()
    browser.open(path)
    assert browser.run("document.getElementById('models').hidden")
    assert browser.run("document.querySelectorAll('#details section').length") == 0
    assert browser.errors == []


def test_pieces_of_faces_are_told_by_their_area(browser, tmp_path):
    vertices, faces = plate()
    vertices[vertices[:, 0] > CORNER[0] + SIZE / 2, 0] += 2 * SIZE  # one column of cells is wide
    visible = np.asarray(example().models[0].visible)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    owner = np.arange(len(faces)) // 3
    cut = PageModel("cut", vertices, faces, visible, owner)
    write_page(tmp_path / "cut.html", example(models=[cut, example().models[1]]))
    browser.errors.clear()
    browser.open(tmp_path / "cut.html", SIZE_OF_PAGE)
    assert browser.run("[...glvis.model().pieceOf]") == owner.tolist()
    found, counts = browser.run("glvis.covered()"), visible.sum(axis=0)
    expected = [areas[counts == n].sum() for n in range(3)]
    assert found["exactly"] == pytest.approx(expected, rel=1e-5)
    assert found["seen"] == pytest.approx((visible * areas).sum(axis=1), rel=1e-5)
    alone = [areas[visible[s] & (counts == 1)].sum() for s in range(2)]
    assert found["alone"] == pytest.approx(alone, rel=1e-5)
    share = 100 * (1 - expected[0] / areas.sum())
    text = browser.run("document.getElementById('stats').textContent")
    assert text.startswith(f"{share:.1f} %")
    assert "faces" not in text
    assert browser.errors == []
    # of several models all are told alike
    browser.run("glvis.setModel(1)")
    assert browser.run("glvis.model().pieceOf") is None
    assert "faces" not in browser.run("document.getElementById('stats').textContent")

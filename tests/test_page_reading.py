"""What readers of the page stumbled over: units, numbers, names, tables, gaps, frusta, phones."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_page import CORNER, HALF, SIZE, SIZE_OF_PAGE, N, box, differs, example, header, plate

from glvis.problem.camera import look_along
from glvis.problem.regions import regions
from glvis.problem.scene import Model
from glvis.viewer.page import page_text, write_page
from glvis.viewer.page_data import PageModel, PageObstacle, PageQuality, PageSensor, PageTable

TAN = example().sensors[0].tan_half


@pytest.fixture
def show(browser, tmp_path):
    """Open a page; the test fails if the console says anything."""

    def opened(data, size=SIZE_OF_PAGE, **options):
        browser.errors.clear()
        path = tmp_path / "report.html"
        write_page(path, data)
        browser.open(path, size, **options)
        return browser

    yield opened
    assert browser.errors == []


def text_of(tab, element):
    return tab.run(f"document.getElementById('{element}').innerText").replace("\u00a0", " ")


def scaled(factor, **changes):
    """The example as large as ``factor`` of itself, at its own middle."""
    data, middle = example(), CORNER + HALF
    models = []
    for model in data.models:
        vertices = (np.asarray(model.vertices) - middle) * factor
        models.append(PageModel(model.name, vertices, model.faces, model.visible))
    sensors = []
    for sensor in data.sensors:
        pose = np.array(sensor.camera_to_world)
        pose[:3, 3] = (pose[:3, 3] - middle) * factor
        sensors.append(PageSensor(sensor.name, "cam", pose, TAN, 100 * factor, 400 * factor))
    return example(models=models, sensors=sensors, obstacles=(), **changes)


# ---- words and numbers


def test_inches_are_spelt_where_in_would_read_as_a_word():
    assert header(page_text(example(unit="in")))["subtitle"].endswith("lengths in inches")
    assert header(page_text(example()))["subtitle"].endswith("1 obstacle, lengths in mm")


@pytest.mark.parametrize(
    ("unit", "factor", "words"),
    [
        ("m", 1e-3, "3,600 mm²"),  # the gap is a quarter of 120 mm x 120 mm
        ("m", 1e-2, "3,600 cm²"),
        ("cm", 1.0, "3,600 cm²"),
        ("mm", 1.0, "3,600 mm²"),
        ("mm", 2.0, "144 cm²"),
        ("m", 0.1, "36.0 m²"),
        ("in", 0.01, "0.360 in²"),
    ],
)
def test_gaps_have_three_digits_in_a_unit_that_suits_them(show, unit, factor, words):
    tab = show(scaled(factor, unit=unit))
    assert text_of(tab, "gaps").split("\n")[-1].removeprefix("1").strip() == words


def test_distances_in_metres_have_as_many_digits_as_in_millimetres(show):
    tab = show(scaled(1e-3, unit="m"))
    tab.run("glvis.setView('Top', 0)")
    tab.settle()
    at = tab.run("glvis.camera().project([-0.02, -0.02, 0])")
    tab.mouse("mouseMoved", at["x"], at["y"])
    tab.settle()
    depths = re.findall(r"(\d+\.\d+) m\b", text_of(tab, "readout"))
    assert depths
    assert all(len(depth.partition(".")[2]) >= 3 for depth in depths)


def test_columns_have_one_number_of_decimals_and_commas_between_thousands(show):
    table = PageTable(
        "T", ("model", "seen %", "faces", "metres"),
        [("a", 97.3, 157293, 0.5), ("b", 97.26, 9, 12.25), ("c", 100.0, 1000, 3.0)],
    )  # fmt: skip
    tab = show(example(tables=[table]))
    cells = tab.run("[...document.querySelectorAll('#details td')].map((c) => c.textContent)")
    columns = np.reshape(cells, (3, 4)).T.tolist()
    assert columns[1] == ["97.3", "97.3", "100.0"]
    assert columns[2] == ["157,293", "9", "1,000"]
    assert columns[3] == ["0.50", "12.25", "3.00"]


def test_shares_are_of_the_area_where_the_objective_is(show):
    vertices, faces = plate()
    vertices[vertices[:, 0] > CORNER[0] + SIZE / 2, 0] += 2 * SIZE
    visible = np.asarray(example().models[0].visible)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    seen = visible.any(axis=0)
    for by_area, share in ((True, areas[seen].sum() / areas.sum()), (False, seen.mean())):
        data = example(models=[PageModel("wide", vertices, faces, visible)], by_area=by_area)
        tab = show(data)
        headline = text_of(tab, "stats").split("\n")
        assert headline[0] == f"{100 * share:.1f} %"
        assert headline[1] == ("area seen" if by_area else "seen")


def test_a_face_tells_how_good_its_best_view_is_or_that_of_the_sensor_looked_at(show):
    data = example()
    (model, _), n = data.models, np.shape(data.models[0].faces)[0]
    sizes = np.full((2, n), 0.5)
    sizes[1], sizes[0, 0] = 0.21, 30.0  # 0.5 lies within the scale of bytes, not at its end
    qualities = [
        PageQuality("# a pixel", "mm", sizes),
        PageQuality("depth error #", "mm", np.full((2, n), 0.4)),
        PageQuality("blur #", "px", np.full((2, n), np.nan)),
    ]
    model = replace(model, visible=np.ones((2, n), dtype=bool), qualities=qualities)
    tab = show(example(models=[model]))
    size = tab.run(f"glvis.model().qualities[0].of(0, {n // 2})")
    assert size == pytest.approx(0.5, rel=0.01)
    assert tab.run("glvis.model().qualities[0].of(0, 0)") == pytest.approx(30)
    assert np.isnan(float(tab.run(f"String(glvis.model().qualities[2].of(0, {n // 2}))")))
    words = tab.run(f"glvis.quality({n // 2}, [0, 1])").replace("\u00a0", " ")
    assert words == "0.21 mm a pixel, depth error 0.4 mm"
    assert tab.run(f"glvis.quality({n // 2}, [0])").startswith("0.5\u00a0mm a pixel, depth")
    tab.run("glvis.setView('Top', 0)")
    tab.settle()
    at = tab.run("glvis.camera().project([-20, -20, 0])")
    for focus, told in ((-1, f"At best {words}"), (0, "A: 0.5 mm a pixel, depth error 0.4 mm")):
        tab.run(f"glvis.state.focus = {focus}")
        tab.mouse("mouseMoved", at["x"] + focus, at["y"])
        tab.settle()
        assert told in text_of(tab, "readout")


def test_longest_headline_fits_the_panel(show):
    vertices, faces = plate()
    faces = np.tile(faces, (10, 1))
    visible = np.ones((2, len(faces)), dtype=bool)
    visible[:, 0] = False  # one face of thousands
    for size in ((1280, 800), (390, 844)):
        tab = show(example(models=[PageModel("flat", vertices, faces, visible)]), size)
        found = tab.run(
            "[...document.querySelectorAll('#stats b')].map((b) => [b.textContent,"
            " b.getBoundingClientRect().right])"
        )
        assert [text.replace("\u00a0", " ") for text, _ in found] == ["> 99.9 %"] * 2 + ["< 0.1 %"]
        lefts = tab.run(
            "[...document.querySelectorAll('#stats b')].map((b) => b.getBoundingClientRect().left)"
        )
        assert found[0][1] <= lefts[1]
        assert found[1][1] <= lefts[2]
        panel = tab.run("document.querySelector('.panel').getBoundingClientRect().right")
        widths = tab.run(
            "[...document.querySelectorAll('#stats b')].map((b) => b.scrollWidth <= b.clientWidth)"
        )
        assert found[2][1] <= panel
        assert all(widths)


# ---- names and tables


def test_names_of_sensors_stay_in_one_line(show):
    names = ["stop1/20", "camera-above-the-north-door"]
    old = example().sensors
    sensors = [
        PageSensor(name, "cam", s.camera_to_world, TAN, 100, 400)
        for name, s in zip(names, old, strict=True)
    ]
    tab = show(example(sensors=sensors), (1280, 800))
    boxes = tab.run(
        "[...document.querySelectorAll('.row .name b')].map((b) => [b.getClientRects().length,"
        " b.offsetHeight, b.scrollWidth <= b.clientWidth, b.parentNode.title])"
    )
    for (lines, height, _, title), name in zip(boxes, names, strict=True):
        assert lines == 1
        assert height < 26
        assert title.startswith(name)
    assert boxes[0][2]  # eight letters are shown whole


def test_what_a_wide_table_cuts_off_casts_a_shadow_until_it_is_scrolled_to(show):
    columns = [f"by {n}+ %" for n in range(2, 12)]
    row = ("a model", *np.linspace(99, 10, 10))
    tab = show(example(tables=[PageTable("T", ("model", *columns), [row])]), (1280, 800))
    tab.run("document.querySelector('.scroll').scrollIntoView({block: 'center'})")
    area = tab.run(
        "(({right, top, height, width}) => [right, top, height, width])"
        "(document.querySelector('.scroll').getBoundingClientRect())"
    )
    right, top, height, _ = (round(v) for v in area)

    def edge():
        strip = tab.screenshot()[top + 2 : top + height - 2, right - 3 : right]
        return strip.reshape(-1, 3).astype(int)

    assert tab.run("(({scrollWidth, clientWidth}) => scrollWidth > clientWidth + 20)"
                   "(document.querySelector('.scroll'))")  # fmt: skip
    cut = np.median(edge(), axis=0).max()
    tab.run("document.querySelector('.scroll').scrollLeft = 1e4")
    whole = np.median(edge(), axis=0).max()
    assert cut < 235 < whole
    # the names of the rows stay
    first = tab.run("document.querySelector('.scroll td').getBoundingClientRect().left")
    assert first == tab.run("document.querySelector('.scroll').getBoundingClientRect().left")


# ---- gaps


def covered_gap():
    """A lid just over the quarter of the plate that nobody sees."""
    corners, faces = box()
    corners = (corners - corners.min(axis=0)) / 30 * [70, 70, 2]
    lid = corners + CORNER + [SIZE / 2 - 5, SIZE / 2 - 5, 3]
    return example(obstacles=[PageObstacle("lid", lid, faces)])


def test_gaps_are_those_that_explain_tells(show):
    vertices, faces = plate()
    x, y, _ = ((vertices[faces].mean(axis=1) - CORNER) / SIZE * N).T
    # two squares that touch at a corner alone, and a strip
    unseen = (x < 3) & (y < 3) | (x > 3) & (x < 6) & (y > 3) & (y < 6) | (x > 10)
    visible = np.tile(~unseen, (2, 1))
    tab = show(example(models=[PageModel("flat", vertices, faces, visible)]))
    found = tab.run("glvis.covered().gaps.map((gap) => [gap.nFaces, gap.area])")
    told = regions(Model.from_arrays("flat", vertices, faces), unseen)
    assert [n for n, _ in found] == [48, 18, 18]
    np.testing.assert_allclose(found, [(region.n_faces, region.area) for region in told], rtol=1e-5)


def loud(image):
    r, g, b = np.moveaxis(image.astype(int), 2, 0)
    return (r > 90) & (r > 2 * g) & (r > 1.5 * b)


def test_obstacles_fade_before_a_gap_that_one_clicks_on(show):
    tab = show(covered_gap())
    tab.run("document.querySelector('#gaps button').click()")
    faded = tab.screenshot()[60:500, :480]
    assert loud(faded).mean() > 0.05
    center = tab.run("glvis.camera().project(glvis.covered().gaps[0].center)")
    assert tab.run(f"glvis.pickAt({center['x']}, {center['y']}).kind") == "model"
    assert "obstacle, faded" in text_of(tab, "legend")
    tab.run("glvis.setView('Top', 0)")
    solid = tab.screenshot()
    assert "faded" not in text_of(tab, "legend")
    assert loud(solid[60:500, :480]).mean() < 0.01


def test_legend_names_what_shines_through(show):
    tab = show(example())
    assert "behind" not in text_of(tab, "legend")
    tab.run("glvis.setMode('unseen')")
    assert "unseen, behind what is seen" in text_of(tab, "legend")
    tab.run("glvis.lookThrough(0, 0)")
    assert "behind" not in text_of(tab, "legend")


def test_on_a_phone_a_tap_on_a_gap_or_an_eye_scrolls_to_the_view(show):
    tab = show(example(), (390, 844), mobile=True)
    for selector in ("#gaps button", ".eye"):
        tab.run("window.scrollTo(0, document.body.scrollHeight)")
        assert tab.run("window.scrollY") > 100
        tab.run(f"document.querySelector('{selector}').click()")
        tab.settle()
        assert tab.run("window.scrollY") == 0


def test_on_a_phone_a_reading_leaves_the_tapped_half_free(show):
    tab = show(example(), (390, 844), mobile=True)
    tab.run("glvis.setView('Top', 0)")
    tab.settle()
    middle = tab.run("glvis.camera().height") / 2
    for corner in ([-40, -40, 0], [-40, 40, 0]):
        at = tab.run(f"glvis.camera().project({corner})")
        spot = {"x": at["x"], "y": at["y"]}
        tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[spot])
        tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        tab.settle()
        box_ = tab.run("(({top, bottom}) => [top, bottom])"
                       "(document.getElementById('readout').getBoundingClientRect())")  # fmt: skip
        assert not box_[0] <= at["y"] <= box_[1]
        assert (box_[0] > at["y"]) == (at["y"] < middle)


# ---- what is drawn


@pytest.mark.parametrize("above", [True, False])
def test_sheet_modelled_from_both_sides_shows_its_front_wherever_one_stands(show, above):
    vertices, faces = plate()
    both = np.concatenate([faces, faces[:, ::-1]])
    visible = np.zeros((2, len(both)), dtype=bool)
    visible[0, : len(faces)] = visible[1, len(faces) :] = True  # A sees the top, B the underside
    data = example(models=[PageModel("sheet", vertices, both, visible)], obstacles=())
    tab = show(data)
    tab.run("for (const name of ['labels', 'frusta']) glvis.show(name, false)")
    tab.run(f"Object.assign(glvis.camera().state, {{yaw: 0.3, pitch: {-0.9 if above else 0.9}}})")
    tab.run("glvis.show('edges', false)")
    tab.settle()
    places = [(0, 0), (-30, -30), (30, -20), (-20, 40), (45, 45), (10, -45)]
    for x, y in places:
        at = tab.run(f"glvis.camera().project([{x}, {y}, 0])")
        hit = tab.run(f"glvis.pickAt({at['x']}, {at['y']})")
        assert hit["kind"] == "model"
        assert (hit["face"] < len(faces)) == above
    centre = tab.run("glvis.camera().project([45, 5, 0])")  # off the axes
    x, y = round(centre["x"]), round(centre["y"])
    patch = tab.screenshot()[y - 12 : y + 12, x - 12 : x + 12].reshape(-1, 3).astype(int)
    is_blue = patch[:, 2] > patch[:, 0]  # A is blue, B orange
    assert is_blue.mean() == (1.0 if above else 0.0)


def test_frusta_begin_short_and_run_out_of_no_side_of_the_picture(show):
    middle = CORNER + HALF
    places = ([90, -60, 150], [-90, 60, 150], [90, 60, 150], [-90, -60, 150])
    sensors = [
        PageSensor(name, "cam", look_along(middle + at, -np.array(at)), TAN, 50, 900)
        for name, at in zip("ABCD", np.array(places, dtype=float), strict=True)
    ]
    visible = np.tile(np.asarray(example().models[0].visible), (2, 1))
    vertices, faces = plate()
    data = example(models=[PageModel("flat", vertices, faces, visible)], sensors=sensors)
    tab = show(data)
    assert not tab.run("glvis.state.frusta")
    short = tab.screenshot()
    tab.run("glvis.show('frusta', true)")
    whole = tab.screenshot()
    width = tab.run("Math.floor(glvis.camera().width)")

    def colored(image):  # along the sides of the picture, below its controls
        rim = np.concatenate([image[70:480, 2:5], image[70:480, width - 5 : width - 2]])
        return int((np.ptp(rim.astype(int), axis=2) > 30).sum())

    assert colored(short) == 0
    assert colored(whole) > 10
    assert differs(short, whole) > 500


def test_axes_end_where_sensors_aim(show):
    tab = show(example())
    found = tab.run("glvis.aims()")
    data = example()
    for aim, sensor in zip(found, data.sensors, strict=True):
        pose = np.asarray(sensor.camera_to_world)
        # the plate lies at the height of its corner
        expected = (pose[2, 3] - CORNER[2]) / pose[2, 2]
        assert aim == pytest.approx(expected, rel=1e-4)

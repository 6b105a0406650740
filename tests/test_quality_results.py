"""How good views are and how projectors disturb each other: tables, words, pictures, commands."""

import csv
import io
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from support import torus_scene
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.app import main
from glvis.cli.explain_words import explain_lines
from glvis.cli.wording import result_lines
from glvis.errors import MachineError
from glvis.evaluation.view_quality import a_metre, quality_of_views, view_quality
from glvis.pictures.bars import Bar, ramp_colors
from glvis.pictures.coloring import KINDS, Seen
from glvis.pictures.places import log_ticks
from glvis.pictures.qualitycolors import (
    INTERFERENCE,
    QUALITIES,
    best_of,
    check_kinds,
    interference_coloring,
    quality_coloring,
    quality_scale,
)
from glvis.pictures.writing import write_views
from glvis.problem.sensor import Focus, Noise, Partner
from glvis.problem.units import fine_unit
from glvis.reports.delivery import deliver
from glvis.reports.report import page_data
from glvis.results.folder import result_folder
from glvis.results.quality_tables import (
    interference_table,
    interference_words,
    quality_columns,
    quality_rows,
    quality_table,
)
from glvis.results.result import write_data, write_summary
from glvis.search.placement import evaluate_poses
from glvis.study.loading import load_study

OLD_COVERAGE = (
    "model,seen_by_all_cameras,unique_seen,total,percentage,area_percentage,"
    "seen_by_2_percentage,seen_by_3_percentage,value"
)
OLD_SENSORS = "sensor,kind,seen,seen_percentage,only_it,only_it_percentage"


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Three plain cameras around two cubes."""
    return evaluate_poses(load_study(write_two_cubes(tmp_path_factory.mktemp("study"))))


def with_sensors(placement, change):
    """Return the placement with every sensor changed by a function of its index and itself."""
    sensors = tuple(change(s, sensor) for s, sensor in enumerate(placement.study.sensors))
    return replace(placement, study=replace(placement.study, sensors=sensors))


@pytest.fixture(scope="module")
def rich(plain):
    """The same, all with noise and light; A and C in one group, B in focus."""

    def change(s, sensor):
        return replace(
            sensor,
            noise=Noise(polynomial=(0.0, 0.0, 1e-3)),
            focus=Focus(0.02, 2.0, 4.0, 1e-5) if s == 1 else None,
            emits="ABA"[s],
        )

    return with_sensors(plain, change)


def tables_of(placement, directory):
    directory.mkdir()
    write_data(placement, directory)
    write_summary(placement, directory)
    index = json.loads((directory / "result.json").read_text())
    texts = [(directory / name).read_text() for name in ("coverage.csv", "sensors.csv")]
    return *texts, index


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


# -- tables


def test_tables_of_plain_cameras_stay_as_they_were_and_others_add_columns_behind(
    plain, rich, tmp_path
):
    coverage, sensors, index = tables_of(plain, tmp_path / "plain")
    assert coverage.splitlines()[0] == OLD_COVERAGE
    assert sensors.splitlines()[0] == OLD_SENSORS
    assert not any("interference" in model for model in index["models"])
    richer = tables_of(rich, tmp_path / "rich")
    for old, new in zip((coverage, sensors), richer, strict=False):
        for old_line, new_line in zip(old.splitlines(), new.splitlines(), strict=True):
            assert new_line.startswith(f"{old_line},")
    for entry in (*index["models"], *index["sensors"]):
        group = richer[2]["models" if "total" in entry else "sensors"]
        (new,) = [one for one in group if one["name"] == entry["name"]]
        assert all(new[key] == value for key, value in entry.items() if key != "quality")


def test_quality_of_a_sensor_is_that_of_all_faces_it_sees(rich, tmp_path):
    _, sensors, index = tables_of(rich, tmp_path / "out")
    rows = rows_of(sensors)
    added = list(rows[0])[len(OLD_SENSORS.split(",")) :]
    assert added == [
        f"{name}_{what}_{unit}"
        for name, unit in (("pixel_size", "mm"), ("depth_error", "mm"), ("blur", "pixels"))
        for what in ("median", "worst_5_percent")
    ]
    for s, (row, entry) in enumerate(zip(rows, index["sensors"], strict=True)):
        sizes = np.concatenate(
            [
                view_quality(m.centroids, m.normals, rich.camera_to_world[s],
                             rich.study.sensors[s]).pixel_size[found.visible[s]]
                for m, found in zip(rich.study.models, rich.maps, strict=True)
            ]
        )  # fmt: skip
        assert float(row["pixel_size_median_mm"]) == np.median(sizes)
        assert float(row["pixel_size_worst_5_percent_mm"]) == np.percentile(sizes, 95)
        assert entry["quality"]["pixel_size"]["median"] == np.median(sizes)
        assert (row["blur_median_pixels"] == "") == (s != 1) == (entry["quality"]["blur"] is None)
        assert float(row["depth_error_median_mm"]) > 0


def test_sensor_that_sees_nothing_has_no_quality(rich):
    blind = replace(rich, maps=tuple(
        replace(m, visible=m.visible & np.array([[True], [False], [True]])) for m in rich.maps
    ))  # fmt: skip
    assert quality_rows(blind)[1].numbers == dict.fromkeys(
        ("pixel_size", "depth_error", "blur"), None
    )
    assert quality_columns(blind)[1][1] == [""] * 6
    assert quality_table(blind)[1][1] == ["B", *["-"] * 6]


def test_interference_stands_in_every_table_in_the_words_and_on_the_page(rich, tmp_path):
    coverage, _, index = tables_of(rich, tmp_path / "out")
    found, models = rich.interference, rich.study.models
    assert (found.groups, found.members) == (("A",), ((0, 2),))
    shares = [100 * found.disturbed_share(m, model) for m, model in enumerate(models)]
    assert 0 < min(shares) <= max(shares) <= 100
    column = [float(row["interference_area_percentage"]) for row in rows_of(coverage)]
    assert column == pytest.approx([*shares, np.mean(shares)])
    for entry, one in zip(index["models"], shares, strict=True):
        assert entry["interference"] == {"area_percentage": one, "by_group": {"A": one}}
    header, rows = interference_table(rich)
    assert header == ["model", "disturbed %"]
    assert [row[0] for row in rows] == ["cube", "small", "mean"]
    words = interference_words(rich)
    assert words.startswith(f"Interference: {np.mean(shares):.1f} % of the area (mean over models")
    assert words.endswith("is lit by two or more projectors of one group ('A': A, C)")
    assert words in list(result_lines(rich))
    assert words in list(explain_lines(rich))
    assert page_data(rich).tables[-1].title == "Interference"


def test_plain_cameras_are_told_of_as_before_and_explained_with_their_pixel_size(plain):
    lines = list(result_lines(plain))
    assert not any("Interference" in line or "pixel size" in line for line in lines)
    assert any("pixel size [mm]  worst 5 % [mm]" in line for line in explain_lines(plain))


def test_light_that_nobody_here_can_follow_is_told_and_costs_nothing_else(
    rich, tmp_path, monkeypatch
):
    def no_opengl(*_):
        raise MachineError("no OpenGL context")

    monkeypatch.setattr("glvis.search.placement.find_interference", no_opengl)
    dark = replace(rich)
    with result_folder(tmp_path / "out") as folder:
        failures = deliver(dark, folder, pictures=False, meshes=False)
    assert failures == ["how projectors disturb each other is not told: there is no OpenGL here"]
    assert (tmp_path / "out" / "coverage.csv").read_text().splitlines()[0] == OLD_COVERAGE


def test_units_suit_small_lengths():
    assert fine_unit(0.5, "mm") == (1.0, "mm")
    assert fine_unit(5e-6, "m") == (1e6, "µm")
    assert fine_unit(0.002, "m") == (1000.0, "mm")
    assert fine_unit(3000.0, "mm") == (0.001, "m")
    assert fine_unit(0.01, "ft") == (pytest.approx(12.0), "in")


# -- colours


def seen_of(placement, m=0) -> Seen:
    study = placement.study
    return Seen(study.models[m], placement.maps[m], study.sensors, placement.camera_to_world, "mm")


def test_colour_of_a_face_is_that_of_its_best_view(rich):
    seen = seen_of(rich)
    found = quality_of_views(
        seen.model.centroids, seen.model.normals, seen.camera_to_world, seen.sensors
    )
    size, density = best_of("pixel-size", seen), best_of("density", seen)
    expected = np.where(seen.map.visible, found.pixel_size, np.inf).min(axis=0)
    np.testing.assert_array_equal(np.isfinite(size), seen.map.counts > 0)
    np.testing.assert_allclose(size[seen.map.counts > 0], expected[seen.map.counts > 0])
    best = a_metre(np.where(seen.map.visible, found.density, 0).max(axis=0), "mm")
    np.testing.assert_allclose(density[best > 0], best[best > 0])
    painted = quality_coloring("pixel-size", seen)
    bar = painted.bar
    shown = seen.map.counts > 0
    expected = ramp_colors(bar.share(size[shown]), 0, 1)
    assert np.array_equal(painted.colors[shown, :3], expected)
    assert bar.label == "smallest pixel size" and bar.unit == "mm"
    assert painted.note.startswith("Median ")


def test_dense_is_light_and_so_is_a_small_pixel(rich):
    seen = seen_of(rich)
    light = ramp_colors(np.array(0.0), 0, 1)
    density, size = (quality_scale(kind, [seen]).bar for kind in ("density", "pixel-size"))
    assert np.array_equal(density.colors(density.high), light)
    assert np.array_equal(size.colors(size.low), light)
    rows = quality_coloring("density", seen).swatches
    assert all(re.fullmatch(r"[a-z]+: ≥ [\d.,]+|no sensor", row.label) for row in rows)


def test_faces_whose_sensors_do_not_say_are_grey_and_told(rich):
    painted = quality_coloring("blur", seen_of(rich))
    visible = seen_of(rich).map.visible
    is_mute = ~visible[1] & visible.any(axis=0)
    assert is_mute.any()
    assert len(np.unique(painted.colors[is_mute], axis=0)) == 1
    assert [row.label for row in painted.swatches] == ["no sensor", "seen, not stated"]


def test_scale_is_one_of_all_models_and_of_factors_where_numbers_differ_much(rich):
    near, far = seen_of(rich, 0), seen_of(rich, 1)
    both = quality_scale("pixel-size", [near, far]).bar
    alone = [quality_scale("pixel-size", [one]).bar for one in (near, far)]
    assert both.low <= min(one.low for one in alone) * 1.1
    assert both.high >= max(one.high for one in alone) / 1.1
    assert not both.is_log
    wide = with_sensors(rich, lambda s, one: replace(
        one, noise=Noise(polynomial=(0.0,) * 12 + (1e-9,))))  # fmt: skip
    assert quality_scale("depth-error", [seen_of(wide)]).bar.is_log


def test_bars_of_nothing_of_one_number_and_of_zeros_are_bars(rich):
    def bar_of(kind, placement):
        seen = seen_of(placement)
        painted = quality_coloring(kind, seen)
        assert painted.colors.shape == (seen.model.n_faces, 4)
        return painted.bar

    unseen = tuple(replace(m, visible=np.zeros_like(m.visible)) for m in rich.maps)
    assert bar_of("pixel-size", replace(rich, maps=unseen)).low < 1
    constant = with_sensors(rich, lambda s, one: replace(one, noise=Noise(polynomial=(2.0,))))
    bar = bar_of("depth-error", constant)
    assert (bar.low, bar.high, bar.is_log) == (1, 4, False)
    exact = with_sensors(rich, lambda s, one: replace(one, noise=Noise(polynomial=(0.0,))))
    bar = bar_of("depth-error", exact)
    assert (bar.low, bar.high, bar.is_log) == (0, 1, False)


def test_bar_of_factors_has_its_geometric_mean_in_the_middle():
    bar = Bar(0.1, 1000.0, "blur", "pixels", is_log=True)
    np.testing.assert_allclose(bar.share([0.01, 0.1, 10, 1000, 5000]), [0, 0, 0.5, 1, 1])
    assert log_ticks(0.1, 1000.0) == [0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000.0]
    assert log_ticks(0.01, 1e4) == [0.01, 0.1, 1, 10, 100, 1000, 1e4]
    assert log_ticks(0.3, 4.0) == [0.3, 0.5, 1, 2, 4.0]


def test_colours_of_interference_count_projectors(rich):
    found, seen = rich.interference, seen_of(rich)
    painted = interference_coloring(seen, found, 0)
    assert [row.label for row in painted.swatches] == [
        "no projector", "1 projector", "2 projectors",
    ]  # fmt: skip
    shares = [float(row.value.split("\u00a0")[0].strip("<>")) for row in painted.swatches]
    assert sum(shares) == pytest.approx(100, abs=0.2)
    for n, row in enumerate(painted.swatches):
        assert (painted.colors[found.most(0) == n, :3] == row.color).all()
    assert painted.facts.startswith(f"{shares[2]:.1f}\u00a0% of the area lit by two or more")
    assert "Group 'A': A, C." in painted.note


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("red", f"color = 'red' must be one of {', '.join((*KINDS, *QUALITIES, INTERFERENCE))}"),
        ("blur", "color = 'blur' needs a sensor that states its focus; none does, see [sensor]"),
        ("depth-error", "color = 'depth-error' needs a sensor that states its noise; none does"),
        ("interference", "color = 'interference' needs two sensors whose 'emits' is the same;"),
    ],
)
def test_colours_that_say_nothing_are_refused(plain, kind, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        check_kinds([kind], plain.study.sensors)


# -- pictures and commands


def names_in(folder):
    return sorted(path.stem for path in folder.glob("*.png"))


def test_further_colours_come_beside_the_usual_pictures(tmp_path):
    study = torus_scene.ring_study(tmp_path)
    placement, size = evaluate_poses(study), (240, 200)
    for name in ("usual", "more", "one"):
        (tmp_path / name).mkdir()
    first = (study, placement.camera_to_world, placement.maps)
    write_views(*first, tmp_path / "usual", size=size)
    write_views(*first, tmp_path / "more", size=size, also=("density", "pixel-size", "unseen"))
    usual, more = names_in(tmp_path / "usual"), names_in(tmp_path / "more")
    assert sorted({*more} - {*usual}) == ["ring-density", "ring-pixel-size"]
    assert {*usual} < {*more}
    write_views(*first, tmp_path / "one", size=size, color="pixel-size")
    assert names_in(tmp_path / "one") == ["ring-pixel-size"]
    a, b = (tmp_path / name / "ring-pixel-size.png" for name in ("one", "more"))
    assert a.read_bytes() == b.read_bytes()
    emitting = tuple(replace(s, emits="ir") for s in study.sensors)
    (tmp_path / "lit").mkdir()
    write_views(
        replace(study, sensors=emitting), *first[1:], tmp_path / "lit", size=size,
    )  # fmt: skip
    assert sorted({*names_in(tmp_path / "lit")} - {*usual}) == ["ring-interference"]
    picture = np.array(Image.open(tmp_path / "lit" / "ring-interference.png"))
    assert picture.shape == (200, 240, 3)


def test_commands_make_further_colours_and_refuse_what_says_nothing(tmp_path, capsys):
    study, out = write_two_cubes(tmp_path, SMALL.replace(', "small.off"', "")), tmp_path / "out"
    words = ["evaluate", str(study), "-o", str(out), "--no-meshes"]
    assert main([*words, "--color", "blur"]) == 2
    assert capsys.readouterr().err == (
        "error: --color 'blur' needs a sensor that states its focus; none does, see [sensor] "
        "focus\n"
    )
    assert main(["optimize", *words[1:], "--color", "depth-error"]) == 2
    assert "--color 'depth-error' needs" in capsys.readouterr().err
    assert not out.exists()
    assert main([*words, "--color", "pixel-size"]) == 0
    assert (out / "views" / "cube-pixel-size.png").exists()
    assert (out / "views" / "cube-unseen.png").exists()
    assert main(["render", str(out), "--color", "density", "--size", "300x200"]) == 0
    assert (out / "views" / "cube-density.png").exists()
    capsys.readouterr()


# -- the page


def test_page_gets_every_number_that_a_sensor_states(plain, rich):
    assert [one.label for one in page_data(plain).models[0].qualities] == ["# a pixel"]
    sizes, errors, blurs = page_data(rich).models[0].qualities
    assert (errors.label, blurs.label, blurs.unit) == ("depth error #", "blur #", "px")
    visible = rich.maps[0].visible
    assert np.shape(sizes.values) == visible.shape
    assert np.isfinite(np.asarray(sizes.values)[visible]).all()
    assert math.isnan(np.asarray(blurs.values)[0, 0])


def test_page_of_very_many_views_leaves_their_numbers_out(plain, monkeypatch):
    monkeypatch.setattr("glvis.reports.report._MOST_VIEWS", 71)  # three sensors on 2 x 12 faces
    assert [model.qualities for model in page_data(plain).models] == [[], []]


def test_partner_of_a_stereo_pair_gives_its_depth_error(plain):
    pair = with_sensors(plain, lambda s, one: replace(
        one, noise=Noise(subpixel=0.1), partner=Partner((0.5, 0, 0), one.lens)))  # fmt: skip
    (row, *_) = quality_rows(pair)
    f = pair.study.sensors[0].focal_pixels()[0]
    back = pair.camera_to_world[0]
    depth = np.concatenate([
        ((back[:3, 3] - model.centroids) @ back[:3, 2])[found.visible[0]]
        for model, found in zip(pair.study.models, pair.maps, strict=True)
    ])  # fmt: skip
    assert row.numbers["depth_error"].median == pytest.approx(
        np.median(depth**2 * 0.1 / (f * 0.5)), rel=1e-9
    )

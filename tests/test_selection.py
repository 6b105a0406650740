"""Which pictures are made without being asked for, and what is said of the others."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from support import torus_scene, two_cubes

from glvis.cli.app import main
from glvis.evaluation.evaluator import Evaluator
from glvis.pictures.selection import chosen_pictures, worst_models
from glvis.pictures.writing import write_views
from glvis.reports.delivery import left_out_lines
from glvis.study.loading import load_study
from glvis.visibility.visibility_map import VisibilityMap


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    study = torus_scene.ring_study(tmp_path_factory.mktemp("ring"))
    with Evaluator(study) as evaluator:
        (seen,) = evaluator.visibility(np.zeros(0))
    return study, torus_scene.start_poses(study), seen


def many_models(ring, n):
    """The ring n times, the k-th one seen the less the larger k is."""
    study, poses, seen = ring
    model = study.models[0]
    models = [replace(model, name=f"ring{k}") for k in range(n)]
    maps = []
    for k in range(n):
        visible = seen.visible.copy()
        visible[:, : k * 10] = False
        maps.append(VisibilityMap(f"ring{k}", seen.sensor_names, visible))
    return replace(study, models=tuple(models)), poses, maps


def many_sensors(folder, n):
    """The ring under n sensors in one place, of which the k-th sees less the larger k is."""
    mount = (
        '[[mount]]\nname = "S{}"\nsensor = "cam"\nposition = [260, -180, 160]\naim = [0, 0, 0]\n'
    )
    text = torus_scene.STUDY.split("[[mount]]")[0] + "".join(map(mount.format, range(n)))
    study = torus_scene.ring_study(folder, text)
    visible = np.ones((n, study.models[0].n_faces), dtype=bool)
    for k in range(n):
        visible[k, : 5 * k] = False
    return (
        study,
        torus_scene.start_poses(study),
        [VisibilityMap("ring", study.sensor_names, visible)],
    )


def test_six_models_are_all_shown_and_of_more_the_three_seen_worst(ring):
    study, _, maps = many_models(ring, 6)
    assert chosen_pictures(study, maps).models == tuple(range(6))
    assert chosen_pictures(study, maps).left_out == ()
    study, _, maps = many_models(ring, 200)
    found = chosen_pictures(study, maps)
    assert found.models == (197, 198, 199)
    assert "of 200 models the 3 seen worst" in found.left_out[0]
    assert chosen_pictures(study, maps, all_pictures=True).models == tuple(range(200))


def test_worst_is_by_what_the_objective_weighs(ring):
    study, _, maps = many_models(ring, 7)
    large = np.argmax(study.models[0].areas)
    few, much = (np.zeros_like(maps[0].visible) for _ in range(2))
    few[0, np.argsort(study.models[0].areas)[:3]] = True  # three small faces
    much[0, large] = True  # one large face: fewer, but more area than a small one
    small = np.argsort(study.models[0].areas)[:1]
    few[:] = False
    few[0, small] = True
    few[0, np.argsort(study.models[0].areas)[1]] = True
    maps[0] = replace(maps[0], visible=few)
    maps[1] = replace(maps[1], visible=much)
    by_faces, by_area = (
        replace(study, objective=replace(study.objective, by_area=which)) for which in (False, True)
    )
    assert worst_models(by_faces, maps)[0] == 1
    areas = study.models[0].areas
    expected = 0 if areas[few[0]].sum() < areas[large] else 1
    assert worst_models(by_area, maps)[0] == expected


def test_eight_sensors_are_all_shown_and_of_more_the_four_that_see_least(tmp_path):
    study, _, maps = many_sensors(tmp_path, 8)
    assert chosen_pictures(study, maps).sensors == tuple(range(8))
    study, _, maps = many_sensors(tmp_path, 60)
    found = chosen_pictures(study, maps)
    assert found.sensors == (56, 57, 58, 59)
    assert "(S56, S57, S58, S59)" in found.left_out[0]


def test_many_models_come_on_contact_sheets_the_least_seen_first(ring, tmp_path):
    study, poses, maps = many_models(ring, 32)
    names = [p.stem for p in write_views(study, poses, maps, tmp_path, size=(400, 300))]
    assert names.count("models-1") == names.count("models-2") == 1
    assert {name.split("-")[0] for name in names} == {
        "ring29",
        "ring30",
        "ring31",
        "sensor",
        "models",
    }
    assert len(names) == 3 * 8 + 3 * 2 + 2
    with Image.open(tmp_path / "models-2.png") as last:
        assert last.size[1] < 300  # two models take no more room than they need


def test_many_sensors_have_few_views_and_one_contact_sheet(tmp_path):
    study, poses, maps = many_sensors(tmp_path, 12)
    names = [p.stem for p in write_views(study, poses, maps, tmp_path, size=(400, 300))]
    assert [n for n in names if n.startswith("sensor-")] == [
        f"sensor-S{k}{end}" for k in range(8, 12) for end in ("", "-depth")
    ]
    assert "ring-contact" in names
    everything = tmp_path / "all"
    everything.mkdir()
    more = write_views(study, poses, maps, everything, size=(400, 300), all_pictures=True)
    assert len([p for p in more if p.name.startswith("sensor-")]) == 24


def study_of_ten_sensors(folder):
    mount = '[[mount]]\nname = "E{}"\nsensor = "eye"\nposition = [{}, 3, 3]\naim = [0, 0, 0]\n'
    text = two_cubes.SMALL.split("[[mount]]")[0] + "".join(
        mount.format(k, k / 2) for k in range(10)
    )
    return two_cubes.write_two_cubes(folder, text)


def test_what_is_left_out_is_said_and_render_makes_it(tmp_path, capsys, monkeypatch):
    def small(*arguments, **options):
        return write_views(*arguments, **options | {"size": (240, 200)})

    monkeypatch.setattr("glvis.reports.delivery.write_views", small)
    study, out = study_of_ten_sensors(tmp_path), tmp_path / "an out"
    assert main(["evaluate", str(study), "-o", str(out), "--no-meshes"]) == 0
    said = capsys.readouterr().out
    assert "of 10 sensors the 4 that see least have views of their own" in said
    assert f"glvis render '{out}' --all-pictures" in said
    assert "of 10 sensors the 4 that see least" in (out / "report.html").read_text()
    assert len(list((out / "views").glob("sensor-*-depth.png"))) == 4
    assert main(["render", str(out), "--color", "unseen"]) == 0  # leaves the others as they are
    assert left_out_lines(out)
    assert main(["render", str(out), "--all-pictures"]) == 0
    assert "see least" not in (out / "report.html").read_text()
    assert len(list((out / "views").glob("sensor-*-depth.png"))) == 10
    assert left_out_lines(out) == []


def test_all_pictures_are_made_at_once_where_they_are_wanted(tmp_path, monkeypatch):
    wanted = []
    monkeypatch.setattr(
        "glvis.reports.delivery.write_views",
        lambda *arguments, **options: wanted.append(options["all_pictures"]) or [],
    )
    study = study_of_ten_sensors(tmp_path)
    out = str(tmp_path / "out")
    assert main(["evaluate", str(study), "-o", out, "--no-meshes", "--all-pictures"]) == 0
    assert wanted == [True]
    assert "see least" not in (tmp_path / "out" / "report.html").read_text()


def test_without_pictures_nothing_is_said_to_be_left_out_of_them(tmp_path, capsys):
    study, out = study_of_ten_sensors(tmp_path), tmp_path / "out"
    assert main(["evaluate", str(study), "-o", str(out), "--no-meshes", "--no-pictures"]) == 0
    assert "see least" not in capsys.readouterr().out
    assert "see least" not in (out / "report.html").read_text()


def test_study_of_ten_sensors_is_one(tmp_path):
    assert len(load_study(study_of_ten_sensors(tmp_path)).sensors) == 10

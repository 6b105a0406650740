"""The meshes and studies in scenes/: what they promise, and that the formulas make them."""

import sys
from pathlib import Path

import make_scenes
import numpy as np
import pytest

from glvis.problem.objective import OVERLAP_WEIGHTS
from glvis.problem.scene import load_model
from glvis.problem.search_options import SearchOptions
from glvis.study.loading import load_study

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "scenes"
ARMS = [f"arm{i}" for i in range(1, 7)]
MESHES = [*ARMS, "holder", "kitchen"]
STUDIES = {
    "arm": (18, 8, 6),
    "arm-noroll": (14, 8, 6),
    "arm-table8": (0, 8, 6),
    "demo": (18, 8, 2),
    "kitchen-2": (12, 2, 1),
    "kitchen-3": (18, 3, 1),
    "kitchen-4": (24, 4, 1),
}
N_FACES = {"holder": (1900, 2100), "kitchen": (6300, 6700)}


@pytest.fixture(scope="module", params=MESHES)
def model(request):
    return load_model(SCENES / f"{request.param}.stl")


def half_edges(model) -> np.ndarray:
    """Each face's three edges in the sense it walks them, (3 F, 2)."""
    return np.concatenate([model.faces[:, [i, (i + 1) % 3]] for i in range(3)])


def edge_lengths(model) -> np.ndarray:
    a, b = np.unique(np.sort(half_edges(model), axis=1), axis=0).T
    return np.linalg.norm(model.vertices[a] - model.vertices[b], axis=1)


def components(model) -> int:
    """Number of pieces: the smallest vertex number spreads along the edges until all is still."""
    label = np.arange(len(model.vertices))
    a, b = half_edges(model).T
    while True:
        spread = label.copy()
        np.minimum.at(spread, a, label[b])
        np.minimum.at(spread, b, label[a])
        spread = spread[spread]
        if np.array_equal(spread, label):
            return len(np.unique(label))
        label = spread


def test_each_mesh_has_the_number_of_faces_of_the_paper(model):
    least, most = N_FACES.get(model.name, (8300, 8700))
    assert least <= model.n_faces <= most


def test_edges_are_even_and_no_face_is_a_sliver(model):
    lengths = edge_lengths(model)
    assert lengths.std() / lengths.mean() < (0.25 if model.name == "kitchen" else 0.15)
    longest = np.max(
        [
            np.linalg.norm(
                model.vertices[model.faces[:, i]] - model.vertices[model.faces[:, i - 1]], axis=1
            )
            for i in range(3)
        ],
        axis=0,
    )
    height = 2 * model.areas / longest
    assert (height > 0.2 * longest).all()


def test_each_edge_has_at_most_two_faces_that_walk_it_in_opposite_directions(model):
    half = half_edges(model)
    assert len(np.unique(half, axis=0)) == len(half)
    _, count = np.unique(np.sort(half, axis=1), axis=0, return_counts=True)
    assert count.max() == 2


@pytest.mark.parametrize("name", [*ARMS, "holder"])
def test_normals_point_outwards(name):
    arm = load_model(SCENES / f"{name}.stl")
    # Seen from a point inside on the elbow's plane the cap would add nothing: it lies edge on.
    inside = arm.vertices[arm.vertices[:, 2] == arm.vertices[:, 2].min()].mean(axis=0)
    a, b, c = (arm.vertices[arm.faces[:, i]] - inside for i in range(3))
    volume = np.sum(a * np.cross(b, c)) / 6
    lower, upper = arm.bounds
    assert 0.05 * np.prod(upper - lower) < volume < 0.6 * np.prod(upper - lower)


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_is_one_piece_with_one_open_loop_at_the_elbow(name):
    arm = load_model(SCENES / f"{name}.stl")
    ends, count = np.unique(np.sort(half_edges(arm), axis=1), axis=0, return_counts=True)
    loop = ends[count == 1]
    assert components(arm) == 1
    # A disc: one loop and no handle, so no two fingers grew together.
    assert len(arm.vertices) - len(ends) + arm.n_faces == 1
    assert len(loop) > 20
    assert np.ptp(arm.vertices[loop.ravel(), 2]) == 0
    assert arm.vertices[loop[0, 0], 2] == arm.bounds[0, 2]


def test_the_holder_is_closed_and_touches_no_arm():
    from scenery.arms import holder_field

    holder = load_model(SCENES / "holder.stl")
    assert holder.is_closed
    assert components(holder) == 1
    assert np.abs(holder_field(holder.vertices)).max() < 0.01
    for name in ARMS:
        arm = load_model(SCENES / f"{name}.stl")
        points = np.concatenate([arm.vertices, arm.centroids])
        assert 0.9 < holder_field(points).min() < 1.1


@pytest.mark.parametrize("name", ARMS)
def test_left_and_right_hands_point_the_thumb_as_the_frame_says(name):
    arm = load_model(SCENES / f"{name}.stl")
    lower, upper = arm.bounds
    is_right = int(name[-1]) % 2 == 0
    assert (upper[0] > -lower[0]) == is_right


def test_arms_grow_from_child_to_adult():
    sizes = [np.ptp(load_model(SCENES / f"{name}.stl").vertices[:, 2]) for name in ARMS]
    assert (np.diff(sizes) > 0).all()
    assert sizes[-1] > 1.5 * sizes[0]


def test_the_kitchen_stays_inside_its_room():
    lower, upper = load_model(SCENES / "kitchen.stl").bounds
    assert (lower >= 0).all()
    assert (upper <= [3000, 3000, 3500]).all()


def test_no_face_of_the_kitchen_lies_on_the_floor_or_on_a_wall():
    kitchen = load_model(SCENES / "kitchen.stl")
    corners = kitchen.vertices[kitchen.faces]
    for axis, wall in ((0, 0), (1, 0), (2, 0), (0, 3000), (1, 3000)):
        assert not (corners[:, :, axis] == wall).all(axis=1).any()


def test_kitchen_faces_look_away_from_the_furniture():
    kitchen = load_model(SCENES / "kitchen.stl")
    up = kitchen.normals[:, 2] > 0.99
    # Worktop of the run: nothing but the sink's floor lies below it and looks up there.
    y, z = kitchen.centroids[:, 1:].T
    top = (np.abs(z - 920) < 1) & (y < 620) & up
    assert top.sum() > 50
    below = (np.abs(z - 860) < 1) & (y > 560) & (y < 620) & (kitchen.normals[:, 2] < -0.99)
    assert below.sum() > 10


@pytest.mark.parametrize("name", ["arm1", "holder", "kitchen"])
def test_the_formulas_make_the_committed_file_bit_for_bit(name):
    made = make_scenes.stl_bytes(name, *make_scenes.MAKERS[name]())
    assert made == (SCENES / f"{name}.stl").read_bytes()


def test_make_scenes_refuses_an_unknown_name(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["make_scenes", "garage"])
    with pytest.raises(SystemExit) as caught:
        make_scenes.main()
    assert caught.value.code == 2
    assert "no scene named garage; there are arm1, " in capsys.readouterr().err


def test_check_says_which_file_differs_and_writes_nothing(monkeypatch, capsys, tmp_path):
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    monkeypatch.setattr(make_scenes, "SCENES", tmp_path)
    monkeypatch.setattr(
        make_scenes, "MAKERS", {"square": lambda: (square, np.array([[0, 1, 2], [0, 2, 3]]))}
    )
    monkeypatch.setattr(sys, "argv", ["make_scenes", "--check"])
    assert make_scenes.main() == 1
    assert "not what the formulas make: square.stl" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(sys, "argv", ["make_scenes"])
    assert make_scenes.main() == 0
    monkeypatch.setattr(sys, "argv", ["make_scenes", "--check"])
    assert make_scenes.main() == 0
    assert load_model(tmp_path / "square.stl").areas.tolist() == [0.5, 0.5]


def test_remeshing_refuses_an_edge_with_three_faces():
    from scenery.remesh import Edges

    with pytest.raises(ValueError, match="1 edges have more than two faces"):
        Edges.of(np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))


def test_a_round_cone_whose_one_ball_holds_the_other_is_refused():
    from scenery.implicit import round_cone

    with pytest.raises(ValueError, match="one ball of a round cone holds the other"):
        round_cone(np.zeros((1, 3)), np.zeros(3), np.array([0.0, 0.0, 1.0]), 3.0, 1.0)


@pytest.mark.parametrize("name", STUDIES)
def test_each_study_has_its_variables_sensors_and_models(name):
    n_variables, n_sensors, n_models = STUDIES[name]
    study = load_study(SCENES / f"{name}.toml")
    assert len(study.variables) == n_variables
    assert len(study.sensor_names) == n_sensors
    assert len(study.models) == n_models


@pytest.mark.parametrize("name", STUDIES)
def test_each_study_names_the_papers_search_and_objective(name):
    study = load_study(SCENES / f"{name}.toml")
    assert study.assumed == ()
    assert study.search == SearchOptions("swarm")
    assert (study.objective.kind, study.objective.by_area) == ("of3", False)
    assert study.objective.overlap == OVERLAP_WEIGHTS["set1"]


def test_every_study_in_the_folder_is_tested():
    assert {path.stem for path in SCENES.glob("*.toml")} == set(STUDIES)


@pytest.mark.parametrize("name", ["arm", "arm-noroll", "demo"])
def test_the_arm_study_starts_at_45_degrees_with_cameras_that_look_at_the_z_axis(name):
    study = load_study(SCENES / f"{name}.toml")
    poses = study.rig.poses(study.rig.start)
    for pose in poses:
        position, direction, image_up = pose[:3, 3], -pose[:3, 2], pose[:3, 1]
        assert np.allclose(np.abs(position), [300 / np.sqrt(2), 300 / np.sqrt(2), 136])
        assert np.allclose(position + 300 * direction, [0, 0, position[2]])
        assert image_up[1] > 0  # roll 0


def test_the_paper_study_has_the_cameras_of_table_8():
    study = load_study(SCENES / "arm-table8.toml")
    poses = dict(zip(study.sensor_names, study.rig.poses(study.rig.start), strict=True))
    assert poses["D1"][:3, 3].tolist() == [-291, 73, 136]
    for name, direction in {"C1": (0.82, 0.55, -0.14), "B2": (-0.66, -0.74, -0.12)}.items():
        unit = np.array(direction) / np.linalg.norm(direction)
        assert np.allclose(-poses[name][:3, 2], unit)
    for pose in poses.values():  # Table 7 read from Table 8: all lie 300 mm from the axis
        assert np.hypot(*pose[:2, 3]) == pytest.approx(300, abs=1)


def test_the_arm_study_holds_the_poses_of_table_8_within_its_bounds():
    study = load_study(SCENES / "arm.toml")
    paper = load_study(SCENES / "arm-table8.toml")
    column = {variable.name: i for i, variable in enumerate(study.variables)}
    x = study.rig.start.copy()
    targets = dict(zip(paper.sensor_names, paper.rig.poses(paper.rig.start), strict=True))
    for name, sign in (("A1", -1), ("B1", 1), ("A2", -1), ("B2", 1)):
        position, direction = targets[name][:3, 3], -targets[name][:3, 2]
        on_ring = np.degrees(np.arctan2(position[1], position[0]))
        azimuth = np.degrees(np.arctan2(direction[1], direction[0])) % 360
        x[column[("alpha" if sign < 0 else "beta") + name[1]]] = sign * on_ring
        x[column["pan" + name]] = azimuth - 180 - on_ring
        x[column[f"{name}.direction.elevation_deg"]] = np.degrees(np.arcsin(direction[2]))
    x[column["A2.roll_deg"]] = 20
    lower, upper = study.rig.bounds.T
    assert ((lower < x) & (x < upper)).all()
    for name, pose in zip(study.sensor_names, study.rig.poses(x), strict=True):
        assert np.allclose(pose[:3, :3], targets[name][:3, :3], atol=1e-6)
        assert np.allclose(pose[:3, 3], targets[name][:3, 3], atol=1)


@pytest.mark.parametrize("name", ["kitchen-2", "kitchen-3", "kitchen-4"])
def test_the_kitchen_study_starts_in_the_middle_with_orthogonal_axes(name):
    study = load_study(SCENES / f"{name}.toml")
    poses = study.rig.poses(study.rig.start)
    assert (poses[:, :3, 3] == [1500, 1500, 1750]).all()
    axes = -poses[:, :3, 2]
    assert np.allclose(np.sum(axes[1:] * axes[:-1], axis=1), 0)
    assert study.objective.w_of2 == 0
    assert study.rig.periodic.sum() == 2 * len(study.sensor_names)

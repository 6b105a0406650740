"""Bad input of every kind ends in one clear line, exit code 2 or 1, and no half a result."""

import errno
import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.app import main
from glvis.results.journal import files_below


def binary_stl(faces: int, corners: float = 1.0) -> bytes:
    face = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, corners, 0, 0, 0, corners, 0, 0)
    return bytes(80) + struct.pack("<I", faces) + face * faces


NO_AREA = """solid flat
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 2 0 0
endloop
endfacet
endsolid flat
"""

# what the mesh file holds: what the line says after its path
MESHES = {
    "empty": (b"", "is empty"),
    "truncated": (binary_stl(10)[:300], "is cut short"),
    "cut after its head": (bytes(60), "is "),
    "NaN": (binary_stl(2, float("nan")), "impossible vertices in 2 of 2 faces: face 0 at"),
    "infinite": (binary_stl(2, float("inf")), "impossible vertices in 2 of 2 faces: face 0 at"),
    "no area": (NO_AREA.encode(), "has 1 faces and none of them has any area"),
    "no faces": (binary_stl(0), "has no faces"),
    "text": (b"once upon a time there was a mesh\n" * 20, "is "),
    "ASCII cut short": (NO_AREA[:60].encode(), "is cut short"),
}


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "study").mkdir()
    write_two_cubes(tmp_path / "study")
    return tmp_path


def refused(capsys, *arguments) -> tuple[int, str]:
    """Run the command line; return exit code and its one line, or fail if there are more."""
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert "Traceback" not in line
    assert line.startswith("error: ")
    return code, line


def refused_study(capsys, folder: Path, text: str) -> str:
    """Return the line about a study, which must be the user's fault and leave nothing."""
    path = folder / "study" / "study.toml"
    path.write_text(text)
    before = files_below(folder)
    code, line = refused(capsys, "optimize", path, "-o", folder / "out")
    assert code == 2
    assert line.startswith(f"error: {path}: ")
    assert files_below(folder) == before
    assert not (folder / "out").exists()
    return line.removeprefix(f"error: {path}: ")


@pytest.mark.parametrize("kind", MESHES)
def test_broken_mesh_is_named(capsys, folder, kind):
    data, fact = MESHES[kind]
    mesh = folder / "study" / "broken.stl"
    mesh.write_bytes(data)
    line = refused_study(capsys, folder, SMALL.replace("small.off", "broken.stl"))
    assert line.startswith(f"[scene] {mesh} ")
    assert fact in line


def test_missing_mesh_is_named(capsys, folder):
    line = refused_study(capsys, folder, SMALL.replace("small.off", "none.stl"))
    assert line == f"[scene] {folder / 'study' / 'none.stl'} does not exist"


# what is put in place of what in the study: the line after the study's path
KEYS = {
    "bounds reversed": (
        "min = 2, max = 6", "min = 6, max = 2",
        "[[mount]] 'A' position[0]: min = 6 must be less than max = 2",
    ),
    "start outside the bounds": (
        "start = 3", "start = 9", "[[mount]] 'A' position[0]: start = 9 must lie in [2, 6]",
    ),
    "unknown sensor": (
        'sensor = "eye"\nposition = [0', 'sensor = "eyes"\nposition = [0',
        "[[mount]] 'C' sensor = 'eyes' is unknown; did you mean 'eye'?; 'glvis sensors'",
    ),
    "unknown key": (
        "roll_deg = 30", "rol_deg = 30",
        "[[mount]] 'C' unknown key 'rol_deg'; did you mean 'roll_deg'?",
    ),
    "unknown variable": (
        "roll_deg = 30", 'roll_deg = "2*turn"', "C.roll_deg = '2*turn': unknown variable 'turn'",
    ),
    "cyclic expression": (
        '[[mount]]\nname = "A"', '[variables]\nu = "v"\nv = "2*u"\n[[mount]]\nname = "A"',
        "cyclic",
    ),
    "not linear": (
        "roll_deg = 30", 'roll_deg = "u*u"\n[variables]\nu = {min=0, max=1}', "roll_deg",
    ),
    "a name twice": ('name = "C"', 'name = "A"', "'A'"),
    "field of view": (
        "hfov_deg = 60", "hfov_deg = 190", "[sensor.eye] hfov_deg = 190 must lie in (0, 180)",
    ),
    "word for a number": (
        "hfov_deg = 60", "hfov_deg = 'wide'", "[sensor.eye] hfov_deg = 'wide' must be a number",
    ),
    "infinite": ("max_distance = 12", "max_distance = inf", "must be finite"),
    "negative particles": (
        "particles = 4", "particles = -4", "[swarm] particles = -4 must be at least 2",
    ),
    "no models": (
        '["cube.off", "small.off"]', "[]", "[scene] models = [] must name at least one mesh",
    ),
    "no mounts": ("[[mount]]", "[[mountain]]", "unknown key 'mountain'; did you mean 'mount'?"),
    "no TOML": ("[scene]", "[scene", "is no TOML: "),
    "an empty file": (SMALL, "", "[scene] is missing"),
}  # fmt: skip


@pytest.mark.parametrize("kind", KEYS)
def test_wrong_key_is_named(capsys, folder, kind):
    old, new, fact = KEYS[kind]
    assert old in SMALL
    line = refused_study(capsys, folder, SMALL.replace(old, new))
    assert fact in line


def test_missing_study_is_named(capsys, tmp_path):
    for command in (["check"], ["evaluate", "-o", tmp_path / "out"]):
        code, line = refused(capsys, *command, tmp_path / "none.toml")
        assert (code, line) == (2, f"error: {tmp_path / 'none.toml'}: does not exist")
    assert list(tmp_path.iterdir()) == []


def test_study_that_is_a_picture_is_refused(capsys, tmp_path):
    (tmp_path / "study.toml").write_bytes(b"\x89PNG\r\n\x1a\n\x00\xff")
    code, line = refused(capsys, "check", tmp_path / "study.toml")
    assert (code, line.split(": ", 2)[2]) == (2, "is no text in UTF-8 (byte 0); save it as UTF-8")


@pytest.mark.parametrize(
    ("setting", "fact"),
    [
        ("swarm.particle=4", "unknown key 'particle'; did you mean 'particles'?"),
        ("max_maps=4", "there is no 'max_maps' in a study; did you mean 'search.max_maps'?"),
        ("by_area=false", "there is no 'by_area' in a study; did you mean 'objective.by_area'?"),
        ("warm.particles=4", "there is no 'warm' in a study; did you mean 'swarm'?"),
        ("mount.Z.roll_deg=4", "there is no 'Z' in mount; there are A, C"),
        ("swarm.particles", "must have the form KEY=VALUE"),
        ("swarm.particles=many", "particles = 'many' must be a whole number"),
        ("=4", "has no key"),
    ],
)
def test_wrong_setting_is_named(capsys, folder, setting, fact):
    study = folder / "study" / "study.toml"
    code, line = refused(capsys, "evaluate", study, "-o", folder / "out", "--set", setting)
    assert code == 2
    assert fact in line
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "fact"),
    [
        (["evaluate", "STUDY"], "Missing option '-o' / '--output'"),
        (["optimize", "STUDY", "-o", "out", "--workers", "0"], "value for '--workers': "),
        (["optimize", "STUDY", "-o", "out", "--seed", "one"], "valid int"),
        (["optimize", "STUDY", "-o", "out", "--sed", "1"], "No such option: --sed"),
        (["optimise"], "No such command 'optimise'"),
        (["check"], "Missing argument 'STUDY'"),
        (["check", "STUDY", "more"], "unexpected extra argument"),
    ],
)
def test_wrong_use_of_the_command_line_is_one_line(capsys, folder, monkeypatch, arguments, fact):
    monkeypatch.chdir(folder)
    study = folder / "study" / "study.toml"
    code, line = refused(capsys, *(study if a == "STUDY" else a for a in arguments))
    assert code == 2
    assert fact in line
    command = "glvis" if arguments[0] == "optimise" else f"glvis {arguments[0]}"
    assert line.endswith(f"'{command} --help' tells more")


def test_no_command_is_answered_by_the_help_alone(capsys):
    assert main([]) == 2
    captured = capsys.readouterr()
    assert "Usage: glvis" in captured.out
    assert captured.err == ""


@pytest.mark.parametrize("name", ["part.stl", "Part.OBJ"])
def test_mesh_in_place_of_a_study_is_told_of_init(capsys, folder, name):
    (folder / name).write_bytes(b"solid \xff")
    code, line = refused(capsys, "check", folder / name)
    fact = "is a mesh, no study; glvis init DIR --model MESH writes a first one"
    assert (code, line) == (2, f"error: {folder / name}: {fact}")


def test_file_in_place_of_a_result_is_refused(capsys, folder):
    study = folder / "study" / "study.toml"
    code, line = refused(capsys, "explain", study)
    assert (code, line) == (2, f"error: {study}: is a file, not the folder of a result")


def test_meshes_that_a_shell_has_unfolded_are_told_how_to_be_named(capsys, folder):
    code, line = refused(capsys, "init", folder / "new", "--model", "a.stl", "b.stl")
    assert code == 2
    assert line.endswith("put --model before each mesh, or quotes about a pattern: --model '*.stl'")


def test_negative_seed_is_refused(capsys, folder):
    study = folder / "study" / "study.toml"
    code, line = refused(capsys, "optimize", study, "-o", folder / "out", "--seed", "-1")
    assert code == 2
    assert line.endswith("[swarm] seed = -1 must be at least 0")


def test_poses_of_other_sensors_are_refused(capsys, folder):
    study = folder / "study" / "study.toml"
    assert main(["evaluate", str(study), "-o", str(folder / "out"), "--no-pictures"]) == 0
    capsys.readouterr()
    renamed = folder / "study" / "renamed.toml"
    renamed.write_text(SMALL.replace('name = "C"', 'name = "top"'))
    code, line = refused(
        capsys, "evaluate", renamed, "-o", folder / "two", "--poses", folder / "out"
    )
    assert code == 2
    assert line.endswith(
        "result.json: has no pose for 'top'; it has A, B, C, the study's sensors are A, B, top"
    )
    assert not (folder / "two").exists()


def test_result_in_a_file_is_refused_before_the_run(capsys, folder):
    study = folder / "study" / "study.toml"
    for output in (study, study / "deeper"):
        code, line = refused(capsys, "optimize", study, "-o", output)
        assert code == 2
        assert "a file" in line


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="this system has no /proc")
def test_result_without_permission_is_refused_before_the_run(capsys, folder):
    study = folder / "study" / "study.toml"
    code, line = refused(capsys, "optimize", study, "-o", "/proc/glvis/out")
    assert code == 1
    assert line.startswith("error: /proc/glvis/out: cannot be written to: ")


@pytest.mark.skipif(os.geteuid() == 0, reason="permissions do not bind the superuser")
def test_result_in_a_locked_folder_is_refused_before_the_run(capsys, folder):
    (folder / "locked").mkdir(mode=0o500)
    study = folder / "study" / "study.toml"
    code, line = refused(capsys, "optimize", study, "-o", folder / "locked" / "out")
    assert code == 1
    assert line.endswith("cannot be written to: Permission denied")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_full_disk_is_one_line_and_leaves_nothing(capsys, folder, monkeypatch):
    def full(path, arrays):
        with Path("/dev/full").open("wb", buffering=0) as file:
            file.write(b"x")

    monkeypatch.setattr("glvis.results.result.write_npz", full)
    study = folder / "study" / "study.toml"
    code, line = refused(capsys, "evaluate", study, "-o", folder / "out", "--no-pictures")
    assert code == 1
    assert line == f"error: {folder / 'out'}: cannot be written to: No space left on device"
    assert not (folder / "out").exists()


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
def test_a_disk_that_takes_no_result_costs_no_search(capsys, folder, monkeypatch, code):
    def refuse(path, arrays):
        raise OSError(code, os.strerror(code))

    study, out, whole = folder / "study" / "study.toml", folder / "out", folder / "whole"
    quick = ["--no-pictures", "--workers", "1"]
    with monkeypatch.context() as disk:
        disk.setattr("glvis.results.result.write_npz", refuse)
        assert main(["optimize", str(study), "-o", str(out), *quick]) == 1
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f"error: {out}: cannot be written to: {os.strerror(code)}")
    assert line.endswith(f"glvis optimize --resume {out}")
    assert main(["optimize", "--resume", str(out), *quick]) == 0
    assert main(["optimize", str(study), "-o", str(whole), *quick]) == 0
    for name in ("visibility.npz", "coverage.csv", "poses.csv"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()


@pytest.mark.parametrize(
    ("environment", "fact"),
    [
        ({"GLVIS_GL": "vulkan"}, "GLVIS_GL = 'vulkan' must be one of egl, osmesa, or unset"),
        (
            {"GLVIS_GL": "egl", "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent"},
            "no OpenGL 3.3 context (egl: ",
        ),
    ],
)
def test_no_opengl_is_one_line_and_leaves_nothing(folder, environment, fact):
    study = folder / "study" / "study.toml"
    run = subprocess.run(
        [sys.executable, "-m", "glvis", "optimize", study, "-o", folder / "out"],
        env={**os.environ, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 1
    assert run.stdout == ""
    (line,) = run.stderr.splitlines()
    assert line.startswith("error: ")
    assert fact in line
    assert not (folder / "out").exists()

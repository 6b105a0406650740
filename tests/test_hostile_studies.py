"""Studies that nobody means: absurd numbers, names, patterns and depths end in one short line."""

import os
import shutil
import tomllib
from pathlib import Path

import pytest
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.app import main
from glvis.cli.wording import resolution_warnings
from glvis.common.files import MOST_TOML
from glvis.study.loading import load_study
from glvis.study.overrides import written


@pytest.fixture
def folder(tmp_path) -> Path:
    write_two_cubes(tmp_path)
    return tmp_path


def refused(capsys, *arguments) -> str:
    """Run a command that must end in one short line with exit code 2; return the line."""
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    (line,) = err.splitlines()
    assert (code, out) == (2, "")
    assert len(line) < 500
    return line


TOO_MUCH = {  # what is put in place of what: what the line says
    "pixels beyond 32 bits": (
        "[swarm]", "[visibility]\nmin_pixels = 2147483648\n[swarm]", "be at most 268435456",
    ),
    "pixels beyond 64 bits": (
        "[swarm]", "[visibility]\nmin_pixels = 99999999999999999999\n[swarm]", "be at most 26843",
    ),
    "distance whose square is infinite": (
        "max_distance = 12", "max_distance = 1e154", "1e+154 must lie in [1e-12, 1e+12]",
    ),
    "field of view of nothing": ("hfov_deg = 60", "hfov_deg = 1e-300", "be at least 1e-12"),
    "inertia": ("[swarm]", "[swarm]\ninertia = [0.1, 1e308]", "must be at most 1000"),
    "overlap": ("[objective]", "[objective]\noverlap = [1e308, 1e308]", "overlap[0] = 1e+308"),
    "weights": ("[objective]", "[objective]\nw_tot = 1e308", "be at most 1e+09 in size"),
    "up": ("up = [0, 1, 0]", "up = [0, 1e308, 1e308]", "must be at most 1e+12 in size"),
    "images of gigabytes": (
        "resolution = [96, 64]",
        """resolution = [16384, 16384]\nmax_distance = 12\n[visibility]\nresolution = "sensor"
        [sensor.other]\nhfov_deg = 60\nvfov_deg = 42\nresolution = [96, 64]""",
        "'eye' would be drawn with 16384 x 16384 pixels, more than 67,108,864",
    ),
    "particles whose square fills memory": ("particles = 4", "particles = 20000", "most 10000"),
    "name of a model": ('"cube.off"', f'"{"a" * 300}.off"', "File name too long"),
    "stars": ('"cube.off"', f'"{"*" * 100_000}"', "must be the name of a file"),
    "pattern that never ends": (
        '"cube.off"', '"/**/*.nothing"', "leads through more than 100,000 files; name a folder",
    ),
    "zero in a name": ('"cube.off"', '"a\\u0000.off"', "must be the name of a file"),
    "dotted key": ("[swarm]", f"{'a.' * 20_000}a = 1\n[swarm]", "is no TOML: nested too deeply"),
    "table in a table": ("[swarm]", f"[sensor{'.a' * 3000}]\n[swarm]", "nested too deeply"),
    "list in a list": ("[swarm]", f"x = {'[' * 300}{']' * 300}\n[swarm]", "nested too deeply"),
    "key": ("[swarm]", f"[swarm]\n{'k' * 200_000} = 1", "unknown key 'kkkkkkkk"),
    "name of a sensor": ("[swarm]", f"[sensor.{'s' * 100_000}]\n[swarm]", "at most 100 letters"),
    "name of a mount": ('name = "A"', f'name = "{"A" * 100_000}"', "at most 100 letters"),
    "unknown sensor": (
        'sensor = "eye"\nposition = [0', f'sensor = "{"e" * 90}"\nposition = [0', "...' is unknown",
    ),
    "sensor of two lines": ("[swarm]", '[sensor."a\\nb"]\n[swarm]', "must be one line"),
    "sensors": (
        "[swarm]",
        "".join(
            f"[sensor.k{i}]\nhfov_deg=9\nvfov_deg=9\nresolution=[9,9]\nmax_distance=9\n"
            for i in range(501)
        ) + "[swarm]",
        "must hold at most 500 sensors",
    ),
    "mounts": (
        "[objective]", "[[mount]]\nname='x'\nsensor='eye'\nposition=[0,0,4]\naim=[0,0,0]\n" * 500
        + "[objective]",
        "at most 500",
    ),
    "file": ("[swarm]", f"# {'x' * MOST_TOML}\n[swarm]", "is larger than 0.3 MB"),
    "values of a varied key": (
        "[swarm]", f"[vary]\nmounts = {list(range(1, 1002))}\n[swarm]",
        "[vary] mounts = [1, 2, 3, ...] must hold at most 1000 values",
    ),
    "runs of varied keys": (
        "[swarm]",
        "[vary]\n" + "".join(
            f"swarm.{key} = {list(range(2, 202))}\n" for key in ("particles", "iterations", "seed")
        ) + "[swarm]",
        "[vary] asks for 8,000,000 runs, at most 1,000",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", TOO_MUCH)
def test_what_is_too_much_is_told_in_one_short_line(capsys, folder, kind):
    old, new, fact = TOO_MUCH[kind]
    assert old in SMALL
    study = folder / "study.toml"
    study.write_text(SMALL.replace(old, new, 1))
    line = refused(capsys, "check", study)
    assert fact in line
    assert refused(capsys, "optimize", study, "-o", folder / "out") == line
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    "setting", ["a." * 20_000 + "a=1", f"{'k' * 100_000}=1", "swarm." + "k" * 999]
)
def test_long_settings_are_cut(capsys, folder, setting):
    assert refused(capsys, "check", folder / "study.toml", "--set", setting)


def test_numbers_at_their_limits_are_run_without_a_warning(capsys, folder):
    study = folder / "study.toml"
    for old, new in [
        ("max_distance = 12", "max_distance = 1e12"),
        ("hfov_deg = 60", "hfov_deg = 1e-12"),
        ("hfov_deg = 60", "hfov_deg = 179.9999999999"),
        ("roll_deg = 30", "roll_deg = 1e12"),
        ("position = [0, 0, 4]", "position = [0, 0, 1e12]"),
    ]:
        study.write_text(SMALL.replace(old, new))
        assert main(["evaluate", str(study), "-o", str(folder / new), "--no-pictures"]) == 0
        assert "RuntimeWarning" not in capsys.readouterr().err


def test_huge_images_are_warned_of(folder):
    text = SMALL.replace("[96, 64]", "[8192, 8192]") + '[visibility]\nresolution = "sensor"\n'
    (folder / "study.toml").write_text(text)
    (warning,) = resolution_warnings(load_study(folder / "study.toml"))
    assert warning.startswith("eye: each map is drawn with 8192 x 8192 pixels, which takes sec")


def test_title_of_two_lines_is_one(folder):
    (folder / "study.toml").write_text(
        SMALL.replace('"Two cubes"', '"""Two\ncubes\\u0000\\u001b[2J"""')
    )
    assert load_study(folder / "study.toml").title == "Two cubes[2J"


def test_study_made_by_windows_is_read(capsys, folder):
    study = folder / "study.toml"
    study.write_bytes(b"\xef\xbb\xbf" + SMALL.replace("\n", "\r\n").encode())
    assert load_study(study).text.startswith('title = "Two cubes"\n')
    for path, fact in {
        r"'..\meshes\cube.off'": r"models = '..\meshes\cube.off' does not exist",
        r'"..\tables\new.off"': r"models = '..\tables\new.off' does not exist",  # a tab, a new line
        r"'..\meshes\*.off'": rf"models = '..\meshes\*.off' matches no file in {folder}",
        r'"..\meshes\cube.off"': r"is no TOML: Unescaped '\' in a string (at line 5, column 16)",
        r'"C:\Users\me\cube.off"': r"is no TOML: Invalid hex value (at line 5, column 16)",
    }.items():
        study.write_text(SMALL.replace('"cube.off"', path))
        line = refused(capsys, "check", study)
        assert line.endswith(rf"{fact}; write '/' in place of '\'")


def test_link_to_itself_is_no_mesh(capsys, folder):
    (folder / "loop.off").symlink_to("loop.off")
    (folder / "study.toml").write_text(SMALL.replace("cube.off", "loop.off"))
    assert refused(capsys, "check", folder / "study.toml").endswith("loop.off does not exist")


def test_pattern_of_any_depth_ends_where_links_lead_back(folder):
    (folder / "a" / "b").mkdir(parents=True)
    (folder / "a" / "b" / "up").symlink_to(folder)
    (folder / "cube.off").rename(folder / "a" / "b" / "cube.off")
    (folder / "study.toml").write_text(SMALL.replace("cube.off", "**/c*.off"))
    assert [m.path for m in load_study(folder / "study.toml").models] == [
        folder / "a" / "b" / "cube.off", folder / "small.off",
    ]  # fmt: skip


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
def test_pipe_is_not_waited_for(capsys, folder):
    os.mkfifo(folder / "pipe.toml")
    assert "is no plain file" in refused(capsys, "check", folder / "pipe.toml")
    os.mkfifo(folder / "pipe.off")
    (folder / "study.toml").write_text(SMALL.replace("cube.off", "pipe.off"))
    assert "pipe.off is not a file" in refused(capsys, "check", folder / "study.toml")


@pytest.mark.skipif(os.name == "nt", reason="names are text there")
def test_names_that_are_no_utf_8_are_told_before_anything_is_run(capsys, folder):
    cube = (folder / "cube.off").rename(os.fsdecode(os.fsencode(folder) + b"/b\xe4ll.off"))
    (folder / "study.toml").write_text(SMALL.replace("cube.off", "b*.off"))
    line = refused(capsys, "check", folder / "study.toml")
    assert line.endswith(
        r"/b\xe4ll.off has a name that is no UTF-8, which no result can hold; "
        "rename the file or its folder"
    )
    cube.rename(folder / "cube.off")
    (folder / "study.toml").write_text(SMALL)
    other = Path(os.fsdecode(os.fsencode(folder.parent) + b"/b\xe4lle"))
    shutil.copytree(folder, other)
    for command in (["check"], ["optimize", "-o", folder / "out"]):
        line = refused(capsys, command[0], other / "study.toml", *command[1:])
        assert "no UTF-8" in line or "no text in UTF-8" in line
    title = os.fsdecode(b"title=\xe4")
    line = refused(capsys, "check", folder / "study.toml", "--set", title)
    assert line == r"error: title=\xe4: is no text in UTF-8; rename what it names"


def test_name_of_two_lines_is_no_model(capsys, folder):
    (folder / "cube.off").rename(folder / "cu\nbe.off")
    (folder / "study.toml").write_text(SMALL.replace("cube.off", "cu*.off"))
    assert "has a line break or control in its name" in refused(
        capsys, "check", folder / "study.toml"
    )


@pytest.mark.parametrize("path", ["x" * 5000, "y/" * 1500])
def test_path_that_is_too_long_is_one_line(capsys, path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for arguments in (["optimize", "--resume"], ["check"], ["render"]):
        assert main([*arguments, path]) in (1, 2)
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("error: ")
        assert len(line) < 500
        assert not any(tmp_path.iterdir())


def test_large_study_is_kept_as_it_was_run():
    source = SMALL + "".join(
        f'[[mount]]\nname = "M{i} \\u007f"\nx.y.z = [1, {{a = "ü"}}]\n' for i in range(900)
    )
    kept = tomllib.loads(written(source, {("swarm", "particles"): 9}))
    expected = tomllib.loads(source)
    expected["swarm"]["particles"] = 9
    assert kept == expected

"""Checkpoints, results and meshes from other hands: whatever is wrong ends in one short line."""

import io
import json
import logging
import os
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from support import damage
from support.two_cubes import SMALL, write_two_cubes
from support.whole_meshes import MESHES, write_mesh

from glvis.cli.app import main
from glvis.common.complaints import one_line
from glvis.errors import StudyError
from glvis.problem.scene import load_model
from glvis.results.given_poses import read_given_poses
from glvis.results.reading import read_result, read_trace
from glvis.results.result import write_csv
from glvis.search.checkpoint import read_checkpoint
from glvis.search.methods import search_from_state
from glvis.study.loading import load_study

METHODS = {"swarm": (), "auto": ("search.method=auto", "search.max_maps=100")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A folder with a finished result by each method and a mesh of each format."""
    folder = tmp_path_factory.mktemp("whole")
    for method, settings in METHODS.items():
        (folder / method).mkdir()
        study = write_two_cubes(folder / method)
        options = [part for setting in settings for part in ("--set", setting)]
        command = ["optimize", str(study), "-o", str(folder / method / "out"), *options]
        assert main([*command, "--workers", "1", "--no-pictures", "--no-meshes"]) == 0
    for suffix in MESHES:
        write_mesh(folder / f"mesh{suffix}")
    return folder


def told(read, *arguments) -> str:
    """Return what a reader says is wrong, or "" where it reads; no other error is forgiven."""
    try:
        read(*arguments)
    except ValueError as error:  # StudyError is one
        assert len(str(error)) < 700  # with the path of a test's folder
        assert len(one_line(str(error))) < 500
        return str(error)
    return ""


def resumed(path: Path, study) -> None:
    search_from_state(study, 1000, read_checkpoint(path, study).search)


@pytest.mark.parametrize("method", METHODS)
def test_damaged_checkpoints_are_told_or_go_on(whole, tmp_path, method):
    out = whole / method / "out"
    study = load_study(out / "study.toml")
    data, path = (out / "checkpoint.npz").read_bytes(), tmp_path / "checkpoint.npz"
    facts = []
    for seed in range(120):
        path.write_bytes(damage.damaged_npz(data, np.random.default_rng(seed)))
        facts.append(told(resumed, path, study))
    assert sum(map(bool, facts)) > 80
    assert len(set(facts)) > 10


@pytest.mark.parametrize(
    "name", ["result.json", "visibility.npz", "reach.npz", "trace.csv", "study.toml"]
)
def test_damaged_results_are_told_or_read(whole, tmp_path, name):
    out = tmp_path / "out"
    shutil.copytree(whole / "auto" / "out", out)
    data, facts = (out / name).read_bytes(), []
    study = load_study(whole / "auto" / "study.toml")
    for seed in range(60):
        (out / name).write_bytes(
            damage.damaged(Path(name).suffix, data, np.random.default_rng(seed))
        )
        facts.append(told(read_result, out))
        if name == "result.json":
            told(read_given_poses, out, study)
    assert sum(map(bool, facts)) > 20


@pytest.mark.parametrize("suffix", MESHES)
def test_damaged_meshes_are_told_or_read(whole, tmp_path, suffix):
    data, path = (whole / f"mesh{suffix}").read_bytes(), tmp_path / f"mesh{suffix}"
    assert load_model(whole / f"mesh{suffix}").n_faces == 12
    facts = []
    for seed in range(30):
        path.write_bytes(damage.damaged(path.suffix, data, np.random.default_rng(seed)))
        facts.append(told(load_model, path))
    assert any(facts)


def edited_checkpoint(whole: Path, path: Path, method: str, change) -> None:
    """Write a checkpoint of which somebody has changed the arrays."""
    with np.load(whole / method / "out" / "checkpoint.npz") as content:
        arrays = {name: content[name] for name in content.files}
    change(arrays)
    np.savez(path, **arrays)


def change_head(key: str, value):
    def change(arrays):
        head = json.loads(str(arrays["head"]))
        head["run"][key] = value
        arrays["head"] = np.array(json.dumps(head))

    return change


CRAFTED = {  # which method's state, what is changed: what is said
    "no trace": ("swarm", lambda a: a.pop("trace"), "trace is missing"),
    "empty trace": ("swarm", lambda a: a.update(trace=np.zeros(0, np.uint8)), "not lead to its"),
    "no poses": ("swarm", lambda a: a.pop("known_poses"), "known_poses is missing"),
    "no counter": ("swarm", change_head("maps_rendered", None), "run.maps_rendered = None must"),
    "another count": ("swarm", change_head("evaluations", 7), "trace does not lead to its counts"),
    "start elsewhere": ("swarm", change_head("start", [1e300]), "start lies outside the bounds"),
    "other width": (
        "swarm", lambda a: a.update({"search.position": np.zeros((4, 9))}), "position has another",
    ),
    "another axis": (
        "swarm", lambda a: a.update({"search.best_x": np.full((1, 1), 3.0)}), "best_x is missing",
    ),
    "not a number": (
        "swarm", lambda a: a["search.velocity"].fill(np.nan), "velocity is too large",
    ),
    "no state": ("swarm", lambda a: a.pop("search.json"), "json is missing"),
    "short values": (
        "auto", lambda a: a.update({"search.values": np.zeros(1)}), "cannot go on",
    ),
    "learned less wide": (
        "auto", lambda a: a.update({"search.learned": a["search.learned"][:, :1]}), "cannot go on",
    ),
    "depth": (
        "auto", lambda a: a.update(head=np.array('{"version": ' + "[" * 200_000)), "no checkpoint",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", CRAFTED)
def test_crafted_checkpoint_says_what_is_wrong(whole, tmp_path, kind):
    method, change, fact = CRAFTED[kind]
    study = load_study(whole / method / "out" / "study.toml")
    edited_checkpoint(whole, tmp_path / "c.npz", method, change)
    assert fact in told(resumed, tmp_path / "c.npz", study)


def test_damaged_checkpoint_leaves_the_result_as_it_was(whole, tmp_path, capsys):
    out = tmp_path / "out"
    shutil.copytree(whole / "swarm" / "out", out)
    edited_checkpoint(whole, out / "checkpoint.npz", "swarm", lambda a: a.pop("trace"))
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert main(["optimize", "--resume", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("is a broken checkpoint: trace is missing or of another type")
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


VALUES = (None, "text", [], {}, float("nan"), 10**400, "\0", "\ud800")


def test_every_value_of_a_result_may_be_anything(whole, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(whole / "auto" / "out", out)
    index = json.loads((out / "result.json").read_text())
    refused = 0
    for key in index:
        for value in VALUES:
            (out / "result.json").write_text(json.dumps({**index, key: value}))
            refused += bool(told(read_result, out))
        (out / "result.json").write_text(json.dumps({k: v for k, v in index.items() if k != key}))
        refused += bool(told(read_result, out))
    assert refused > 60
    (out / "result.json").write_text('{"poses": ' + "[" * 200_000)
    assert told(read_result, out).endswith("is no JSON: nested too deeply")


@pytest.mark.parametrize("command", [["explain"], ["render"], ["evaluate", "--poses"]])
def test_pipes_in_a_result_are_not_waited_for(whole, tmp_path, capsys, command):
    for name in ("result.json", "visibility.npz", "trace.csv", "study.toml"):
        out = tmp_path / name
        shutil.copytree(whole / "swarm" / "out", out)
        (out / name).unlink()
        os.mkfifo(out / name)
        if command[0] == "evaluate":
            if name == "result.json":
                more = [str(whole / "swarm" / "study.toml"), "-o", str(tmp_path / "new")]
                assert main([*command, str(out), *more]) == 2
                assert "is no plain file but a pipe" in capsys.readouterr().err
            continue
        assert main([*command, str(out)]) == 2
        assert f"{name}: is no plain file but a pipe" in capsys.readouterr().err


@pytest.mark.parametrize("array", [np.full((3, 12), 0.5), np.full((3, 12), "x"), np.zeros((3, 9))])
def test_maps_of_other_types_are_refused(whole, tmp_path, array):
    out = tmp_path / "out"
    shutil.copytree(whole / "swarm" / "out", out)
    np.savez(out / "visibility.npz", sensors=np.array(["A", "B", "C"]), cube=array, small=array)
    assert told(read_result, out).endswith("its maps are not those of the study")


def test_archive_that_promises_petabytes_takes_no_memory(whole, tmp_path):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "|b1", "fortran_order": False, "shape": (8 * 10**15,)}
    )
    out = tmp_path / "out"
    shutil.copytree(whole / "swarm" / "out", out)
    with zipfile.ZipFile(out / "visibility.npz", "w") as archive:
        archive.writestr("cube.npy", head.getvalue())
    assert "promises more than it holds" in told(read_result, out)
    with zipfile.ZipFile(out / "visibility.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("cube.npy", bytes(50_000_000))
    assert "unfolds to more than" in told(read_result, out)


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        (lambda i: i.update(repeats=0), "repeats = 0 must lie in"),
        (lambda i: i.update(repeats=10**9), "asks for 1,000,000,000 runs"),
        (lambda i: i.update(vary={"mounts": [None]}), "must hold no null"),
        (lambda i: i.update(vary=3), "vary = 3 must be a table"),
        (lambda i: i.pop("title"), "title is missing"),
    ],
)
def test_crafted_series_is_one_line(whole, tmp_path, capsys, change, fact):
    index = {"glvis_schema": 1, "title": "Two\ncubes", "vary": {}, "repeats": 2}
    change(index)
    (tmp_path / "repeats.json").write_text(json.dumps(index))
    shutil.copy(whole / "swarm" / "out" / "study.toml", tmp_path)
    assert main(["optimize", "--resume", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert fact in line


def test_broken_line_of_a_trace_is_named(whole, tmp_path):
    lines = (whole / "swarm" / "out" / "trace.csv").read_text().splitlines()
    for line in ("1,2", lines[1].replace(",", ",nan,", 1), "x" * 200_000, lines[1] + "\0"):
        (tmp_path / "trace.csv").write_text("\n".join([*lines[:2], line]))
        with pytest.raises(StudyError, match=r"trace\.csv: line 3 is broken$"):
            read_trace(tmp_path / "trace.csv")


def glb(**tables) -> bytes:
    """Return a GLB of one triangle, some of its tables replaced."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    blob = points + np.arange(3, dtype="<u4").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 48}],
    }
    text = json.dumps(document | tables).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def test_glb_promises_no_more_than_it_holds(tmp_path):
    path = tmp_path / "a.glb"
    path.write_bytes(glb())
    assert load_model(path).n_faces == 1
    accessor = {"componentType": 5126, "count": 10**9, "type": "VEC3"}
    path.write_bytes(glb(accessors=[accessor]))
    assert told(load_model, path) == "promises 1,000,000,000 entries that it does not hold"
    path.write_bytes(glb(nodes=[{"mesh": 0}] * 20_000))
    assert told(load_model, path).startswith("places more than 10,000 parts; join them")


def test_3mf_unfolds_to_no_more_than_it_holds(whole, tmp_path):
    path = tmp_path / "a.3mf"

    def write(change):
        with (
            zipfile.ZipFile(whole / "mesh.3mf") as old,
            zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new,
        ):
            for name in old.namelist():
                text = old.read(name)
                new.writestr(name, change(text) if name.endswith(".model") else text)

    write(lambda text: text)
    assert load_model(path).n_faces == 12
    end = b"</build>"
    write(lambda text: text.replace(end, b" " * 50_000_000 + end))
    assert told(load_model, path).startswith("unfolds from ")
    write(lambda text: text.replace(end, b'<item objectid="1"/>' * 5000 + end))
    assert told(load_model, path).startswith("places more than 1,000 parts")
    chain = b"".join(
        b'<object id="%d"><components>%s</components></object>'
        % (n, b'<component objectid="%d"/>' % (n - 1) * 2)
        for n in range(2, 40)
    )
    item = b'<item objectid="39"/>'
    write(
        lambda text: text.replace(b"</resources>", chain + b"</resources>").replace(end, item + end)
    )
    assert told(load_model, path).startswith("places more than 1,000 parts")


ASCII = """solid
facet normal 0 0 1
vertex 0 0 0
vertex 1 0 0
vertex 0 1 0
endfacet
endsolid"""


@pytest.mark.parametrize(
    ("name", "text", "fact"),
    [
        ("a.obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {'9' * 31}", "more than 64 bits"),
        ("a.off", f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {'9' * 31}", "more than 64 bits"),
        ("a.off", f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 {'x' * 9999}\n3 0 1 2", "xxx..."),
        (
            "a.stl",
            ASCII.replace("0 0 0", f"{'x' * 9999} 0 0"),
            "xxx...' is no number",
        ),
        (
            "a.stl",
            ASCII.replace(" 1", " 1e-44"),
            "is 1e-44 across, less than 1e-09; is its unit right?",
        ),
    ],
)
def test_mesh_beyond_every_number_is_told(tmp_path, name, text, fact):
    (tmp_path / name).write_text(text)
    assert told(load_model, tmp_path / name).endswith(fact) or fact in told(
        load_model, tmp_path / name
    )


def test_reading_of_large_meshes_is_told(tmp_path, monkeypatch, capsys, caplog):
    study = write_two_cubes(tmp_path)
    monkeypatch.setattr("glvis.problem.scene._LARGE", (tmp_path / "cube.off").stat().st_size)
    assert main(["evaluate", str(study), "-o", str(tmp_path / "out"), "--no-pictures"]) == 0
    assert "Reading cube.off, 0 MB ...\n" in capsys.readouterr().err
    logging.getLogger("glvis").handlers = []  # of a library that is used, nothing is heard
    load_study(study)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("first", ["=", "+", "-", "@", "\t", "\r"])
def test_texts_in_tables_are_no_formulas_and_numbers_stay(tmp_path, first):
    write_csv(tmp_path / "a.csv", ["model", "value"], [[f"{first}1+2", -1.5], ["plain", 2]])
    text = (tmp_path / "a.csv").read_bytes().decode()
    assert text == f"model,value\n'{first}1+2,-1.5\nplain,2\n"


def test_model_that_is_called_like_a_formula_is_none(tmp_path):
    write_two_cubes(tmp_path)
    (tmp_path / "small.off").rename(tmp_path / "=HYPERLINK(1).off")
    kind = SMALL.replace("[sensor.eye]", '[sensor."=1+1"]').replace('= "eye"', '= "=1+1"')
    (tmp_path / "study.toml").write_text(kind.replace("small.off", "=HYPERLINK(1).off"))
    out = tmp_path / "out"
    assert main(["evaluate", str(tmp_path / "study.toml"), "-o", str(out), "--no-pictures"]) == 0
    assert "\n'=HYPERLINK(1)," in (out / "coverage.csv").read_text()
    assert ",'=1+1," in (out / "poses.csv").read_text()
    assert ",'=1+1," in (out / "sensors.csv").read_text()


def test_fuzzer_runs_the_commands():
    # in a process of its own: its children could not use the OpenGL that this one has by now
    fuzzer = Path(__file__).resolve().parents[1] / "tools" / "fuzz.py"
    run = subprocess.run(
        [sys.executable, fuzzer, "--cases", "3", "--seed", "2"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines()[-1].split()[:2] == ["all", "3"]

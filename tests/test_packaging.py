"""What a wheel holds: every module, every shader, every file of the viewer, and nothing else."""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import glvis
from glvis.common.hints import installed_by
from glvis.results.result import versions

ROOT = Path(__file__).resolve().parents[1]


def files_below(folder: Path, prefix: str) -> set[str]:
    """Return the files of a folder as the wheel should name them, caches left out."""
    return {
        f"{prefix}/{path.relative_to(folder).as_posix()}"
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".pyc"
    }


def build(kind: str, source: Path, target: Path) -> Path:
    """Build a distribution without network and return its path."""
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(target)],
        cwd=source,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (built,) = target.iterdir()
    return built


def names_in(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    return build("wheel", ROOT, tmp_path_factory.mktemp("wheel"))


def test_wheel_holds_every_shader_and_every_file_of_the_package(wheel):
    shaders = files_below(ROOT / "shaders", "glvis/shaders")
    assert shaders
    package = {name for name in names_in(wheel) if name.startswith("glvis/")}
    assert package == shaders | files_below(ROOT / "glvis", "glvis")


def test_wheel_holds_nothing_besides_the_package_and_its_description(wheel):
    others = {name.split("/")[0] for name in names_in(wheel)} - {"glvis"}
    assert len(others) == 1
    assert others.pop().endswith(".dist-info")


def test_wheel_says_that_its_types_may_be_read(wheel):
    assert "glvis/py.typed" in names_in(wheel)


def test_wheel_names_the_command_and_the_licence(wheel):
    with zipfile.ZipFile(wheel) as archive:
        texts = {
            Path(name).name: archive.read(name).decode()
            for name in archive.namelist()
            if ".dist-info/" in name
        }
    assert "glvis = glvis.__main__:main" in texts["entry_points.txt"]
    assert "MIT License" in texts["LICENSE"]


def test_distribution_has_a_name_of_its_own_and_the_version_of_the_package(wheel):
    # "glvis" on the index is a widget for notebooks by others
    assert wheel.name == f"glvis_placement-{glvis.__version__}-py3-none-any.whl"
    assert versions()["glvis"] == glvis.__version__  # whatever else is installed as "glvis"


def test_the_version_stands_in_one_place(wheel):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "version" not in project and project["dynamic"] == ["version"]
    with zipfile.ZipFile(wheel) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        told = archive.read(name).decode()
    assert f"\nVersion: {glvis.__version__}\n" in told
    assert "\nProject-URL:" not in told and "\nHome-page:" not in told  # it has no home yet
    assert told.count("\nClassifier: ") >= 8


def test_the_wheel_holds_every_page_of_the_manual(wheel):
    pages = {f"glvis/docs/{path.name}" for path in (ROOT / "glvis" / "docs").glob("*.md")}
    assert pages and pages <= names_in(wheel)


def test_nobody_is_told_to_install_glvis_from_an_index():
    told = re.compile(
        r"""pip3? (install|download) (-\S+ )*['"]?glvis(?!_placement-)|\bglvis\\*\[[a-z]"""
    )
    names = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "pyproject.toml")
    files = [ROOT / name for name in names]
    for folder in ("glvis", "scenes", "tests", "tools"):
        files += [path for path in (ROOT / folder).rglob("*") if path.is_file()]
    texts = {
        path: path.read_text(encoding="utf-8", errors="replace")
        for path in files
        if path.suffix not in (".png", ".pyc", ".stl", ".npz") and path != Path(__file__)
    }
    assert len(texts) > 100
    assert [str(path) for path, text in texts.items() if told.search(text)] == []


@pytest.mark.parametrize("extra", ["bench", "cluster"])
def test_what_is_missing_is_installed_from_the_checkout_or_a_wheel(extra):
    told = installed_by(extra)
    assert f'pip install ".[{extra}]" in the checkout' in told
    assert f'"WHEEL[{extra}]"' in told
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert extra in project["optional-dependencies"]


def test_wheel_made_from_the_source_distribution_is_the_same(wheel, tmp_path):
    archive = build("sdist", ROOT, tmp_path / "sdist")
    with tarfile.open(archive) as source:
        for member in source.getmembers():  # 3.11.2 has no extraction filter, later ones ask for it
            path = tmp_path / "unpacked" / member.name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(source.extractfile(member).read())
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    again = build("wheel", unpacked, tmp_path / "again")
    assert names_in(again) == names_in(wheel)

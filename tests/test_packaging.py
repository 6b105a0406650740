"""What a wheel holds: every module, every shader, every file of the viewer, and nothing else."""

import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

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


def test_wheel_names_the_command_and_the_licence(wheel):
    with zipfile.ZipFile(wheel) as archive:
        texts = {
            Path(name).name: archive.read(name).decode()
            for name in archive.namelist()
            if ".dist-info/" in name
        }
    assert "glvis = glvis.__main__:main" in texts["entry_points.txt"]
    assert "MIT License" in texts["LICENSE"]


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

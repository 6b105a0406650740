"""The page that leads from the paper to the code names what exists, and leaves no step out."""

import importlib
import re

import pytest
from support.named_tests import TESTS, cases_named, is_there

PAGE = (TESTS.parent / "glvis" / "docs" / "paper.md").read_text(encoding="utf-8")
NAMES = sorted(set(re.findall(r"`(glvis(?:\.\w+)+)`", PAGE)))
CASES = cases_named(PAGE)
STEPS = {
    *("CropFOV", "CropBack", "CropNorm", "CropNear", "RGB-D filter", "obstacle model"),
    *("sweep strategy", "centroid strategy", "VM", "OF1", "OF1_area", "OF2", "OF3"),
    *("mean over models", "PSO step"),
    *(f"Table {n}" for n in (1, 2, 3, 4, 5, 8)),
    *(f"Eq. ({n})" for n in range(1, 8)),
    *(f"Fig. {n}" for n in (1, 2, 9)),
}


def rows() -> list[list[str]]:
    """Return the cells of all tables with a function and a test."""
    cells = [
        [cell.strip() for cell in line.strip("| ").split(" | ")]
        for line in PAGE.splitlines()
        if line.startswith("| ")
    ]
    return [row for row in cells if len(row) == 4 and row[0] != "paper" and row[0] != "---"]


def named(name: str) -> object:
    """Return what a dotted name means: a module, or something in one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        module = ".".join(parts[:n])
        try:
            found = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if not module.startswith(
                str(error.name)
            ):  # it is there, and something that it needs is not
                raise
            continue
        for part in parts[n:]:
            found = getattr(found, part)
        return found
    raise ModuleNotFoundError(name)


def test_each_step_of_the_paper_has_one_row():
    steps = [row[0] for row in rows()]
    assert sorted(set(steps)) == sorted(steps)
    assert STEPS - set(steps) == set()


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_each_row_names_one_function_one_test_and_what_differs(row):
    _, function, case, differs = row
    assert function.strip("`") in NAMES
    assert case.strip("`") in CASES
    assert differs


@pytest.mark.parametrize("name", NAMES)
def test_each_function_that_is_named_exists(name):
    assert named(name) is not None


@pytest.mark.parametrize("case", CASES)
def test_each_test_that_is_named_exists(case):
    assert is_there(case)


@pytest.mark.parametrize("name", ["glvis.no_such.thing", "glvis.problem.camera.no_such"])
def test_a_function_that_is_gone_would_be_noticed(name):
    with pytest.raises((AttributeError, ModuleNotFoundError)):
        named(name)

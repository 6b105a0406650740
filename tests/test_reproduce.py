"""The paper, reproduced: runs that go on where they were, and a page made of their numbers."""

import csv
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
import reproduce as program

from glvis.problem.visibility_options import VisibilityOptions
from glvis.results.folder import result_folder
from glvis.results.reading import read_result
from glvis.search.placement import evaluate_poses, place_sensors
from glvis.search.reach import Sampler

TINY = ["swarm.particles=2", "swarm.iterations=1"]


@pytest.fixture
def reproduce(monkeypatch):
    parts = {"arms": ("arms-table-8", "arms"), "kitchen": ("kitchen-2",)}
    monkeypatch.setattr(program, "QUICK", TINY)
    monkeypatch.setattr(program, "PARTS", parts)
    return program


@pytest.fixture
def run(reproduce, monkeypatch, capsys, tmp_path):
    """Run the tool into the test's folder; return its exit code, what it said, its errors."""

    def run(*arguments: str) -> tuple[int, str, str]:
        where = ("-o", str(tmp_path / "out"), "--docs", str(tmp_path / "docs"))
        command = ["reproduce", *where, "--quick", "--workers", "1", "--no-pictures", *arguments]
        monkeypatch.setattr("sys.argv", command)
        try:
            code = reproduce.main()
        except SystemExit as end:
            code = end.code
        return (code, *capsys.readouterr())

    return run


def cells(page: str, first: str) -> list[str]:
    """Return the cells of the row that begins so."""
    (row,) = [line for line in page.splitlines() if line.startswith(f"| {first} |")]
    return [cell.strip() for cell in row.strip("|").split("|")]


def test_what_was_cut_off_goes_on_and_what_is_done_stays_done(run, reproduce, tmp_path):
    class Broken(Exception):
        pass

    def broken(progress):
        raise Broken

    study = reproduce.case_study("kitchen-2", None, [*TINY, "swarm.seed=1"])
    path = tmp_path / "out" / "quick" / "kitchen-2-1"
    with suppress(Broken), result_folder(path) as folder:
        folder.keep_study(study.text)
        place_sensors(study, checkpoint=folder.checkpoint, on_iteration=broken)
    assert not (path / "result.json").exists()
    code, _, said = run("--only", "kitchen", "--repeats", "2")
    assert code == 0 and "done before" not in said
    found = read_result(path)
    assert np.array_equal(found.position, place_sensors(study).position)

    page = (tmp_path / "docs" / "reproduced.md").read_text()
    counted = []
    for seed in (1, 2):
        with (path.parent / f"kitchen-2-{seed}" / "coverage.csv").open() as file:
            counted.append(next(csv.DictReader(file)))
    row = cells(page, "2")
    assert row[4] == "2 quick"
    assert row[1:4] == ["6,882 [321]", "5,198 [66]", "80 %"]  # Table 11
    unique = [int(entry["unique_seen"]) for entry in counted]
    assert row[6] == f"{np.mean(unique):,.0f} [{np.std(unique, ddof=1):,.0f}]"
    assert row[9] == f"{max(float(entry['percentage']) for entry in counted):.1f} %"
    assert "**Quick runs, not the paper's settings**" in page
    assert "2 particles, up to 1 iterations" in page
    assert "Not run yet: `tools/reproduce.py --only arms`" in page

    code, _, said = run("--only", "kitchen", "--repeats", "2")
    assert code == 0 and said.count("done before") == 2
    reproduce.QUICK = [*TINY, "swarm.initial='uniform'"]
    with pytest.raises(reproduce.StudyError, match="holds a run with other meshes or settings"):
        run("--only", "kitchen", "--repeats", "1")


def test_a_search_that_somebody_ended_is_gone_on_with(run, reproduce, tmp_path, monkeypatch):
    stopped = []

    def interrupted(study, **options):
        def stop(progress):
            raise KeyboardInterrupt

        stopped.append(options["resume"])
        return place_sensors(study, **options | {"on_iteration": stop})

    with monkeypatch.context() as meanwhile:
        meanwhile.setattr("glvis.search.placement.place_sensors", interrupted)
        code, _, said = run("--only", "kitchen", "--repeats", "1")
    assert code == 130 and said.endswith("stopped; the same command goes on\n")
    assert not (tmp_path / "docs").exists()
    monkeypatch.setattr(
        "glvis.search.placement.place_sensors",
        lambda study, **options: (
            stopped.append(options["resume"]) or place_sensors(study, **options)
        ),
    )
    monkeypatch.setattr("sys.argv", ["reproduce"])
    code, _, _ = run("--only", "kitchen", "--repeats", "1")
    assert code == 0 and stopped == [False, True]
    found = read_result(tmp_path / "out" / "quick" / "kitchen-2-1")
    assert found.stop_reason == "finished: all 1 iterations done"


def test_the_page_of_the_arms_holds_the_numbers_of_the_run(reproduce):
    found = place_sensors(reproduce.case_study("arms", None, TINY), sampler=Sampler())
    fixed = evaluate_poses(reproduce.case_study("arms-table-8", None))
    runs = {name: [] for name in ("kitchen-2", "kitchen-3", "kitchen-4")}
    runs["arms-table-8"] = [reproduce.Run(fixed, None, True)]
    pages = {}
    for is_quick in (True, False):
        runs["arms"] = [reproduce.Run(found, None, is_quick)]
        pages[is_quick] = "\n".join(reproduce.page_lines(runs, [("a.png", "An arm")]))
    page = pages[True]
    for n, (model, seen) in enumerate(zip(found.study.models, found.maps, strict=True), 1):
        row = cells(page, str(n)) if n > 2 else None  # Table 7 has rows 1 and 2 as well
        if row:
            assert row[5:9] == [
                f"{seen.n_total:,}",
                f"{seen.n_unique:,}",
                f"{model.n_faces:,}",
                f"{100 * seen.coverage:.1f} %",
            ]
            assert float(row[11].rstrip(" %")) >= float(row[8].rstrip(" %"))
    by_its_rules = replace(found.study, visibility=VisibilityOptions.paper())
    lenient = evaluate_poses(by_its_rules, found.camera_to_world).maps
    shown = float(cells(page, "mean")[9].rstrip(" %"))
    assert shown == pytest.approx(100 * np.mean([m.coverage for m in lenient]), abs=0.051)
    assert cells(page, "mean")[1:5] == ["13,398", "8,365", "8,510", "98.3 %"]  # of Table 9
    assert cells(page, "maps rendered")[2] == f"{found.maps_rendered:,}"
    assert f"see {100 * np.mean([m.coverage for m in fixed.maps]):.1f} % of these arms" in page
    assert "Not run yet: `tools/reproduce.py --only kitchen`" in page
    assert "![An arm](pictures/a.png)" in page
    # a time means something only where the settings are those of the paper
    assert "time of the search" not in page
    assert cells(pages[False], "time of the search")[1] == "41.3 h"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--only", "garage"), "--only: no garage; choose from arms, kitchen"),
        (("--repeats", "0"), "--repeats 0: must be at least 1"),
        (("--data", "/nowhere"), "--data /nowhere: there is no such folder"),
    ],
)
def test_what_cannot_be_run_is_refused(run, tmp_path, arguments, message):
    code, _, error = run(*arguments)
    assert code == 2 and message in error
    assert not (tmp_path / "out").exists()

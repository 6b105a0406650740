"""The check of a graphics card: what it says, and that it fails where maps are wrong."""

import subprocess
import sys
import time
from pathlib import Path

import gpu_check
import measuring
import pytest
from support import verdicts

from glvis.errors import MachineError
from glvis.visibility import context

TOOLS = Path(__file__).resolve().parents[1] / "tools"
SECTIONS = ("Driver", "Maps against rays", "Maps a second", "Where the time goes")


@pytest.fixture
def check(capsys, monkeypatch):
    """Run the tool in this process; return its exit code, the report, what it said meanwhile."""

    def check(*arguments: str, **instead) -> tuple[int, str, str]:
        for name, value in instead.items():
            monkeypatch.setattr(gpu_check, name, value)
        try:
            code = gpu_check.main(arguments)
        except SystemExit as end:
            code = end.code
        return (code, *capsys.readouterr())

    return check


def cells(report: str, first: str) -> list[list[str]]:
    """Return the rows of tables whose first cell begins with some words."""
    lines = [line for line in report.splitlines() if line.startswith(f"| {first}")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_report_has_every_section_with_figures_and_is_written_to_a_file(tmp_path):
    path = tmp_path / "report.md"
    done = subprocess.run(
        [sys.executable, TOOLS / "gpu_check.py", "--small", "-o", path],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    report = done.stdout
    assert path.read_text(encoding="utf-8") == report and "**All is right.**" in report
    assert [line[3:] for line in report.splitlines() if line.startswith("## ")] == list(SECTIONS)
    assert "Maps against rays ..." in done.stderr and "| " not in done.stderr
    for what in ("vendor", "renderer", "version", "kind", "largest texture"):
        ((_, said),) = cells(report, what)
        assert said
    verdicts = cells(report, "sheet box") + cells(report, "coincident")
    assert len(verdicts) >= 5 and {row[-1] for row in verdicts} == {"yes"}
    times = cells(report, "dented ball")
    assert [row[1] for row in times] == ["1", "10", "100"]
    assert all(float(cell.replace(",", "")) > 0 for cell in times[0][2:])
    ((_, *totals),) = cells(report, "all |")
    assert len(totals) == 3 and all(float(total) > 0 for total in totals)
    steps = report.partition("| step |")[2].splitlines()[2:-2]
    for column in range(2, 5):  # shares of the whole
        parts = [line.split("|")[column] for line in steps if line.startswith("|")]
        shares = [int(part.split("(")[1].split()[0]) for part in parts if "(" in part]
        assert len(shares) > 3 and 95 <= sum(shares) <= 105


def test_a_wrong_map_is_named_and_ends_in_an_error(check, monkeypatch):
    right = verdicts._maps
    monkeypatch.setattr(
        verdicts, "_maps", lambda way, *rest: right(way, *rest) ^ (way.criterion == "centroid")
    )
    nothing = {"maps_a_second": lambda *_: None, "where_time_goes": lambda *_: None}
    code, report, progress = check("--small", **nothing)
    assert code == 1 and "**Not all is right:**" in report and "**All is right.**" not in report
    assert "- coincident, centroid, NumPy: IoU 0." in report and "WRONG: coincident" in progress
    assert {row[-1] for row in cells(report, "coincident")} == {"yes", "**no**"}


def test_what_stops_a_section_is_named_and_the_others_have_their_turn(check):
    def broken(*_):
        raise RuntimeError("the driver gave up")

    nothing = {"maps_a_second": lambda *_: None, "where_time_goes": lambda *_: None}
    code, report, _ = check("--small", maps_against_rays=broken, **nothing)
    assert code == 1 and "- Maps against rays: RuntimeError: the driver gave up" in report
    assert [line[3:] for line in report.splitlines() if line.startswith("## ")] == list(SECTIONS)


def test_a_machine_without_opengl_is_told_what_is_missing(check, monkeypatch):
    def nobody():
        raise MachineError("no OpenGL 3.3 context (egl: found 0 EGL devices)")

    monkeypatch.setattr(context, "gl_context", nobody)
    code, report, _ = check("--small")
    assert code == 1 and "- Driver: MachineError: no OpenGL 3.3 context" in report
    assert "## Maps" not in report


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--fast",), "unrecognized arguments: --fast"),
        (("-o", "/nowhere/report.md"), "-o /nowhere/report.md: must be a file in a folder"),
    ],
)
def test_arguments_that_cannot_be_are_refused_before_anything_is_done(check, arguments, message):
    code, report, error = check(*arguments)
    assert code == 2 and message in error and not report


def test_profile_leaves_everything_as_it_was_and_counts_no_time_twice(monkeypatch):
    class Work:
        def outer(self):
            time.sleep(0.02)
            self.inner("deep")

        def inner(self, name):
            time.sleep(0.03)

    monkeypatch.setattr(measuring, "Work", Work, raising=False)
    steps = [("measuring", "Work", "outer", "outer"), ("measuring", "Work", "inner", "in {1}")]
    steps += [("measuring", "Work", "gone", "gone"), ("measuring", "Nobody", "outer", "gone")]
    monkeypatch.setattr(measuring, "_STEPS", tuple(steps))
    kept = dict(vars(Work))
    start = time.perf_counter()
    with measuring.Profile() as profile:
        Work().outer()
    took = time.perf_counter() - start
    assert dict(vars(Work)) == kept and list(profile.seconds) == ["in deep", "outer", "all else"]
    assert profile.seconds["in deep"] >= 0.03 and profile.seconds["outer"] >= 0.02
    assert sum(profile.seconds.values()) <= took

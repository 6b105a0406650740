"""The comparison of the methods: what is finished is not done again, and equal budgets are kept."""

import json

import compare_methods
import pytest


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the tool into the test's folder; return its exit code, what it said, its errors."""

    def run(*arguments: str) -> tuple[int, str, str]:
        command = ["compare_methods", "-o", str(tmp_path / "out"), "--workers", "1", *arguments]
        monkeypatch.setattr("sys.argv", command)
        try:
            code = compare_methods.main()
        except SystemExit as end:
            code = end.code
        return (code, *capsys.readouterr())

    return run


def test_methods_are_compared_at_equal_maps_and_what_is_done_stays_done(run, tmp_path):
    asked = ("--only", "kitchen-2", "--methods", "greedy,refine", "--maps", "120", "--seeds", "2")
    code, first, _ = run(*asked)
    assert code == 0
    tmp_path = tmp_path / "out"
    summary = json.loads((tmp_path / "methods.json").read_text())
    assert len(summary["runs"]) == 4
    for record in summary["runs"]:
        maps, best = zip(*record["trace"], strict=True)
        assert maps[0] == 2 and maps[-1] == record["maps_rendered"] <= 120
        assert list(best) == sorted(best) and best[-1] == record["value"]
    rows = [line for line in first.splitlines() if line.startswith("| kitchen-2")]
    assert len(rows) == 2 and sum("**" in row for row in rows) == 1
    assert (tmp_path / "methods.png").read_bytes()[:4] == b"\x89PNG"
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()}
    assert len(before) == 4  # no checkpoint is left
    _, again, progress = run(*asked)
    assert again == first and progress.count("done before") == 4
    _, _, progress = run(*asked[:5], "140", "--seeds", "1")  # another budget, another search
    assert "done before" not in progress
    assert (
        before.items() <= {p: p.stat().st_mtime_ns for p in (tmp_path / "runs").iterdir()}.items()
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--methods", "swarm,magic"), "--methods: no magic; choose from swarm, auto"),
        (("--only", "garage"), "--only: no garage; choose from arms, kitchen-2"),
        (("--seeds", "0"), "--seeds 0: must be at least 1"),
        (("--data", "/nowhere"), "--data /nowhere: there is no such folder"),
    ],
)
def test_what_cannot_be_compared_is_refused(run, tmp_path, arguments, message):
    code, _, error = run(*arguments)
    assert code == 2 and message in error
    assert not (tmp_path / "out").exists()

"""Commands about results that are there, through the command line."""

import pytest
from support.two_cubes import write_two_cubes

from glvis.cli.app import main
from glvis.results.journal import files_below
from glvis.results.reading import read_result


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("result")
    (folder / "study").mkdir()
    study = write_two_cubes(folder / "study")
    assert main(["evaluate", str(study), "-o", str(folder / "out"), "--no-pictures"]) == 0
    return folder / "out"


@pytest.fixture
def run(capsys):
    def run(*arguments) -> tuple[int, str, str]:
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return code, out, err

    return run


def test_explain_names_reasons_regions_and_sensors(run, result):
    before = files_below(result)
    code, out, err = run("explain", result)
    assert (code, err) == (0, "")
    for heading in ("Unseen area and why", "Largest unseen regions", "Sensors: what each sees",
                    "Where overlap is thin"):  # fmt: skip
        assert f"\n{heading}" in f"\n{out}"
    assert files_below(result) == before


def test_tolerance_tells_spread_sensitivity_and_loss(run, result):
    code, out, err = run(
        "tolerance", result, "--position", "1cm", "--angle", "5deg", "--samples", "5", "--lose"
    )
    assert (code, err) == (0, "")
    assert out.startswith("5 layouts, every sensor up to 10 mm off along each axis and 5 deg in")
    assert "\nMost sensitive: " in out
    assert "\nWith one sensor lost\n" in out


def test_rounded_layout_becomes_a_result_of_its_own(run, result, tmp_path):
    out = tmp_path / "rounded"
    code, text, _ = run("tolerance", result, "--round", "0.5mm,5deg", "-o", out)
    assert code == 0
    assert text.startswith("Rounded poses [mm, deg]")
    rounded = read_result(out)
    assert f"OF3 = {rounded.value:.4f} instead of {read_result(result).value:.4f}" in text
    assert set((rounded.camera_to_world[:, :3, 3] % 0.5).ravel()) == {0.0}


def test_rounded_layout_may_be_told_only(run, result):
    code, text, _ = run("tolerance", result, "--round", "0.5mm")
    assert code == 0
    assert "\nThey see " in text


@pytest.mark.parametrize(
    ("arguments", "fact"),
    [
        (["tolerance"], "says nothing to try: --position 1mm, --angle 0.5deg, --lose or --round"),
        (["tolerance", "--position", "far"], "--position far: must be a length such as 1mm"),
        (["tolerance", "--lose", "-o", "x"], "-o: takes the rounded layout; it needs --round"),
        (["tolerance", "--round", "1mm,1m"], "--round 1m: 'm' must be deg"),
    ],
)
def test_wrong_wishes_are_one_line(run, result, arguments, fact):
    code, out, err = run(arguments[0], result, *arguments[1:])
    assert (code, out) == (2, "")
    assert err.startswith(f"error: {fact}")


@pytest.mark.parametrize("command", ["explain", "tolerance", "render"])
def test_commands_refuse_a_folder_without_result(run, tmp_path, command):
    code, _, err = run(command, tmp_path)
    assert (code, err) == (2, f"error: {tmp_path / 'result.json'}: does not exist\n")

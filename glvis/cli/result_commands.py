"""Commands about results that are there: pictures again, explanations, tolerances."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from glvis.cli.options import AllPictures, Overwrite, ResultFolder
from glvis.errors import StudyError

commands = typer.Typer()


@commands.command(
    epilog="Examples:  glvis render out/arm  or one of them from another side:  glvis render "
    "out/arm --color unseen --view 30,20 --size 1920x1080"
)
def render(
    result: ResultFolder,
    view: Annotated[
        str | None,
        typer.Option(
            metavar="AZIMUTH,ELEVATION",
            help="Where pictures in perspective are taken from, degrees: 0,0 is the front, "
            "90,0 the right, 0,90 the top.",
        ),
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WIDTHxHEIGHT", help="Pixels of a picture.")
    ] = None,
    color: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="Only the pictures coloured by sensor, overlap, incidence, distance, unseen, "
            "pixel-size, density, depth-error, blur or interference; the others stay.",
        ),
    ] = None,
    all_pictures: AllPictures = False,
) -> None:
    """Make the pictures and the page of a result again.

    Poses and maps are those of the result; its meshes are read again.
    """
    from glvis.cli.terminal import say
    from glvis.reports.delivery import Look, left_out_lines, render_again

    look = Look(color=color, all_pictures=all_pictures)
    if size:
        width, height = _two_numbers("--size", size, "x", "1920x1080")
        look = replace(look, size=(round(width), round(height)))
    if view:
        look = replace(look, view=_two_numbers("--view", view, ",", "30,20"))
    names = render_again(result, look)
    say(_pictures_line(names, result))
    _say_all(left_out_lines(result))


def _two_numbers(option: str, text: str, between: str, example: str) -> tuple[float, float]:
    """Return the two numbers of an option."""
    parts = text.split(between)
    try:
        first, second = map(float, parts)
    except ValueError:
        raise StudyError(
            f"{option} {text}: must be two numbers with '{between}' between, as {example}"
        ) from None
    return first, second


@commands.command(epilog="Example:  glvis explain out/arm")
def explain(result: ResultFolder) -> None:
    """Say what stays unseen and why, what each sensor is good for, where overlap is thin.

    Every unseen face has one reason: nothing looks there, turned away, too far, too near, too
    oblique, hidden; that of the sensor that came closest to seeing it. What a sensor would see
    if it looked the other way is seen from behind: is the mesh inside out?
    """
    from glvis.cli.explain_words import explain_lines
    from glvis.cli.terminal import say
    from glvis.results.reading import read_result

    for line in explain_lines(read_result(result)):
        say(line)


@commands.command(
    epilog="Examples:  glvis tolerance out/arm --position 1mm --angle 0.5deg  and  glvis "
    "tolerance out/arm --round 1mm,0.5deg -o out/arm-rounded"
)
def tolerance(
    result: ResultFolder,
    position: Annotated[
        str, typer.Option(metavar="LENGTH", help="Largest mounting error along each axis: 1mm.")
    ] = "0",
    angle: Annotated[
        str, typer.Option(metavar="ANGLE", help="Largest error of tilt, pan and roll: 0.5deg.")
    ] = "0",
    samples: Annotated[int, typer.Option(min=1, help="Random layouts to look at.")] = 200,
    seed: Annotated[int, typer.Option(min=0, help="Of the random numbers.")] = 1,
    lose: Annotated[bool, typer.Option("--lose", help="Lose each sensor in turn.")] = False,
    rounding: Annotated[
        str | None,
        typer.Option(
            "--round",
            metavar="LENGTH,ANGLE",
            help="Round poses to whole steps, such as 1mm,0.5deg, and say what that costs.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder for the rounded result."),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Say what a layout is worth when it is not mounted exactly as planned.

    Lengths and angles may carry their unit; without one they are in the study's and in degrees.
    """
    from glvis.cli.terminal import say
    from glvis.cli.tolerance_words import (
        loss_lines,
        rounding_lines,
        sensitivity_lines,
        spread_lines,
    )
    from glvis.reports.delivery import deliver
    from glvis.results.folder import result_folder
    from glvis.results.reading import read_result
    from glvis.results.tolerance import (
        degrees_of,
        length_of,
        random_errors,
        rounded_poses,
        single_errors,
    )
    from glvis.search.placement import evaluate_poses

    planned = read_result(result)
    unit = planned.study.unit
    length, degrees = length_of(position, unit, "--position"), degrees_of(angle, "--angle")
    if output and not rounding:
        raise StudyError("-o: takes the rounded layout; it needs --round, as 1mm,0.5deg")
    if not (length or degrees or lose or rounding):
        raise StudyError("says nothing to try: --position 1mm, --angle 0.5deg, --lose or --round")
    if length or degrees:
        radians = math.radians(degrees)
        found = list(random_errors(planned, length, radians, samples, seed))
        losses = single_errors(planned, length, radians)
        _say_all(spread_lines(planned, found, length, degrees))
        say()
        _say_all(sensitivity_lines(planned, losses, length, degrees))
    if lose:
        _say_all(loss_lines(planned))
    if rounding:
        step, _, turn = rounding.partition(",")
        poses = rounded_poses(
            planned, length_of(step, unit, "--round"), degrees_of(turn or "0", "--round")
        )
        if not output:
            _say_all(rounding_lines(planned, evaluate_poses(planned.study, poses)))
            return
        with result_folder(output, overwrite=overwrite) as folder:
            rounded = evaluate_poses(planned.study, poses)
            failures = deliver(rounded, folder)
        _say_all(rounding_lines(planned, rounded))
        _say_all(f"Warning: {failure}" for failure in failures)


def _say_all(lines: Iterable[str]) -> None:
    from glvis.cli.terminal import say

    for line in lines:
        say(line)


@commands.command(epilog="Example:  glvis compare out/start out/arm -o out/compared")
def compare(
    results: Annotated[list[Path], typer.Argument(metavar="DIR DIR ...", help="Two or more.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder for pictures; new or empty."),
    ] = None,
) -> None:
    """Set layouts side by side: numbers, how far sensors moved, what only one of them sees.

    With -o: for each model the layouts in the same view, and a map of the difference.
    """
    from glvis.cli.compare_words import comparison_lines
    from glvis.reports.compare import named, shared_models, write_comparison
    from glvis.results.folder import result_folder
    from glvis.results.reading import read_result

    if len(results) < 2:
        raise StudyError("compare needs two or more results")
    layouts = named(results, [read_result(result) for result in results])
    if output is None:
        _say_all(comparison_lines(layouts))
        return
    if not shared_models(layouts):
        raise StudyError("-o: no model is the same mesh in all layouts; there is nothing to draw")
    with result_folder(output) as folder:
        paths = write_comparison(layouts, folder.staging)
        names = [path.name for path in paths]
    _say_all(comparison_lines(layouts))
    _say_all([_pictures_line(names, output)])


def _pictures_line(names: Sequence[str], folder: Path) -> str:
    pictures = "1 picture" if len(names) == 1 else f"{len(names)} pictures"
    return f"{pictures} in {folder}: {', '.join(names)}"

"""The commands about a study: a first one, what is in it, what its start sees, the search."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glvis.cli.options import (
    AllPictures,
    Colors,
    DryRun,
    NoMeshes,
    NoPictures,
    Output,
    Overwrite,
    Repeats,
    Set,
    StudyFile,
    Sweep,
    Vary,
)
from glvis.errors import StudyError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from glvis.problem.study import Study
    from glvis.reports.delivery import Look
    from glvis.search.placement import Placement

commands = typer.Typer()


@commands.command(
    epilog="Examples:  glvis init first  or for your own mesh:  glvis init first --model part.stl "
    "--unit in --sensors 4  or for a room:  glvis init watched --model hall.glb --room"
)
def init(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the study.")],
    model: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="MESH",
            help="What is to be seen: STL, OBJ, PLY ... Many times, or a pattern in quotes.",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            help="Of the mesh's lengths: mm, cm, m, in, ft; glTF and 3MF say theirs, else mm."
        ),
    ] = None,
    sensors: Annotated[int | None, typer.Option(min=1, max=64, help="How many.")] = None,
    sensor: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the catalogue: see 'glvis sensors'.")
    ] = None,
    up: Annotated[
        str | None,
        typer.Option(help="Axis that points up in the mesh: x, y or z; y in glTF, else z."),
    ] = None,
    around: Annotated[
        bool, typer.Option("--around", help="A part that is held: sensors on all sides.")
    ] = False,
    above: Annotated[
        bool,
        typer.Option("--above", help="It stands on a floor: no sensor below its lowest point."),
    ] = False,
    room: Annotated[
        bool,
        typer.Option(
            "--room", help="A room: sensors within it, high up, at least 0.3 m off the walls."
        ),
    ] = False,
    together: Annotated[
        bool | None,
        typer.Option(
            "--together/--each", help="Several meshes are one thing, or looked at one by one."
        ),
    ] = None,
    example: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Without a mesh of yours: arm, kitchen or room."),
    ] = None,
) -> None:
    """Write a first study: commented, and it runs as it is.

    Bounds, ranges and start follow from the size of the mesh. What is not given is guessed, and
    what was guessed is said.
    """
    from glvis.cli.terminal import say
    from glvis.study.starter import next_commands, write_starter
    from glvis.study.starter_study import Choices

    wanted = {"around": around, "above": above, "room": room}
    places = [name for name, is_wanted in wanted.items() if is_wanted]
    if len(places) > 1:
        raise StudyError(f"--{places[0]} and --{places[1]} exclude each other")
    place = places[0] if places else None
    choices = Choices(unit, sensors, sensor, up, place, together)
    path = write_starter(directory, model or (), example=example, choices=choices, on_remark=say)
    say(f"Wrote {path}. Next:")
    for command in next_commands(path):
        say(f"  {command}", to_paste=True)


@commands.command(epilog="Example:  glvis check scenes/arm.toml")
def check(study: StudyFile, overrides: Set = None) -> None:
    r"""Read a study, say what is in it, what it will cost and what will disappoint.

    Nothing is written. Prints models, obstacles, sensors, variables with bounds and start, the
    resolution of the renders, the OpenGL driver, and how long a full run takes here; of a study
    with a table \[vary] all its runs.
    """
    from glvis.cli.series_commands import planned_runs
    from glvis.cli.terminal import say
    from glvis.cli.wording import cost_lines, study_lines
    from glvis.evaluation.checks import size_doubts
    from glvis.evaluation.workers import available_cores
    from glvis.search.estimate import measured_cost
    from glvis.study.loading import load_study

    loaded = load_study(study, overrides or ())
    runs = planned_runs(loaded, overrides or ())
    for line in study_lines(loaded):
        say(line)
    say()
    for warning in [*size_doubts(loaded), *_warnings(loaded)]:
        say(f"Warning: {warning}")
    for line in [*cost_lines(measured_cost(loaded), available_cores()), *runs]:
        say(line)


@commands.command(
    epilog="Example:  glvis evaluate scenes/arm.toml -o out/start,  or with the poses of another "
    "result:  glvis evaluate scenes/arm.toml -o out/again --poses out/arm/result.json"
)
def evaluate(
    study: StudyFile,
    output: Output,
    poses: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Poses in place of the study's start, by the names of the sensors: a result or "
            "its folder, poses.csv, COLMAP's images.txt, or JSON of 4 x 4 matrices.",
        ),
    ] = None,
    overrides: Set = None,
    overwrite: Overwrite = False,
    no_pictures: NoPictures = False,
    all_pictures: AllPictures = False,
    colors: Colors = None,
    no_meshes: NoMeshes = False,
) -> None:
    """Say what the start poses, or given ones, see; nothing is searched.

    Writes study.toml (as run), result.json (poses, coverage), coverage.csv and sensors.csv
    (tables), visibility.npz (which sensor sees which face) and pictures in views/.
    """
    from glvis.reports.delivery import deliver
    from glvis.results.folder import result_folder
    from glvis.results.given_poses import read_given_poses
    from glvis.search.placement import evaluate_poses
    from glvis.study.loading import load_study

    loaded = load_study(study, overrides or ())
    look = _look(loaded, colors, all_pictures)
    given = read_given_poses(poses, loaded) if poses else None
    warnings = _warnings(loaded)
    with result_folder(output, overwrite=overwrite) as folder:
        placement = evaluate_poses(loaded, given)
        _say_that_pictures_come(not no_pictures)
        failures = deliver(
            placement, folder, warnings=warnings, pictures=not no_pictures, meshes=not no_meshes,
            look=look,
        )  # fmt: skip
    _say_what_came(placement, output, warnings, failures)


@commands.command(
    epilog="Examples:  glvis optimize scenes/arm.toml -o out/arm  or a shorter run:  glvis "
    "optimize scenes/arm.toml -o out/try --set swarm.particles=50 --set swarm.iterations=30  "
    "or go on with one:  glvis optimize --resume out/arm --extend 50  or how many sensors it "
    "takes:  glvis optimize scenes/kitchen-4.toml -o out/many --vary mounts=2,3,4 --repeats 3"
)
def optimize(
    study: Annotated[
        Path | None,
        typer.Argument(
            metavar="STUDY",
            help="The study, a TOML file; may be left out with --resume.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder for the result; made new."),
    ] = None,
    overrides: Set = None,
    seed: Annotated[
        int | None, typer.Option(help="Of the random numbers: the same seed, the same result.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes that render; the result is the same for any number. "
            "As many as there are cores, unless given.",
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Render on the workers of a dask cluster instead, by the address of its "
            "scheduler, such as tcp://scheduler:8786; needs the extra 'cluster'.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    resume: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Go on with the search that was cut off, or ended, in DIR."
        ),
    ] = None,
    extend: Annotated[
        int, typer.Option(min=0, help="Iterations to add to a search, with --resume.")
    ] = 0,
    repeats: Repeats = None,
    vary: Vary = None,
    sweep: Sweep = None,
    dry_run: DryRun = False,
    no_pictures: NoPictures = False,
    all_pictures: AllPictures = False,
    colors: Colors = None,
    no_meshes: NoMeshes = False,
) -> None:
    r"""Search the poses that see most.

    Ctrl-C ends the search well: the best so far is written as a complete result. The state of
    the search is kept after every iteration: what was killed goes on with --resume.

    Writes what 'evaluate' writes, trace.csv (best and mean value of each iteration) and
    checkpoint.npz (what --resume needs).

    With --repeats, --vary or a table \[vary] in the study: many searches, each a result in a
    folder of its own, run-01 ..., with a table, a plot and a summary of all. Pictures are made
    of the best run. --resume goes on with the runs that have not finished.
    """
    from glvis.cli.series_commands import optimize_many
    from glvis.cli.terminal import progress_shown, say
    from glvis.evaluation.workers import available_cores
    from glvis.reports.delivery import deliver
    from glvis.results.folder import STUDY, result_folder, series_index, settle_folder
    from glvis.search.placement import place_sensors
    from glvis.search.reach import Sampler
    from glvis.study.loading import load_study

    # one for all runs of a series
    sampler = Sampler(lambda: say("Sampling what is within reach ...", error=True))

    def search(loaded: Study, checkpoint: Path, goes_on: bool) -> Placement:
        with progress_shown() as show:
            return place_sensors(
                loaded,
                workers=1 if cluster else workers or available_cores(),
                cluster=cluster,
                on_iteration=show,
                checkpoint=checkpoint,
                resume=goes_on,
                extend=extend,
                sampler=sampler,
            )

    if study and study.is_dir() and not resume:
        study, resume = None, study
    if extend and not resume:
        raise StudyError("--extend adds to a search that was run before: it needs --resume DIR")
    if resume and output:
        raise StudyError("-o: a search that goes on writes into its own folder, --resume DIR")
    if workers and cluster:
        raise StudyError("--workers are processes here, --cluster has its own: give one of them")
    directory = resume or output
    if not (study or resume) or (directory is None and not dry_run):
        raise StudyError("needs STUDY and -o DIR, or --resume DIR; 'glvis optimize --help'")
    settings = [*(overrides or ()), *([] if seed is None else [f"swarm.seed={seed}"])]
    early = load_study(study, settings) if study else None  # before any folder is made
    if early:
        _look(early, colors, all_pictures)
    if directory and not dry_run:
        settle_folder(directory)  # it may turn out to hold a series
    if repeats or vary or dry_run or (early and early.vary) or (resume and series_index(resume)):
        optimize_many(
            directory, early, settings, search, options=vary or (), repeats=repeats,
            dry_run=dry_run, resume=resume is not None, extend=extend, overwrite=overwrite,
            warnings=_warnings, pictures=not no_pictures, all_pictures=all_pictures,
            colors=colors or (), meshes=not no_meshes,
        )  # fmt: skip
        return
    assert directory
    with result_folder(directory, overwrite=overwrite, resume=resume is not None) as folder:
        loaded = early or load_study(folder.staging / STUDY, settings)
        look = _look(loaded, colors, all_pictures)
        if not folder.goes_on:
            if extend:
                raise StudyError(
                    f"{directory}: its search was killed before it began; there is nothing to "
                    "--extend, --resume alone begins it"
                )
            folder.keep_study(loaded.text)
        warnings = _warnings(loaded)
        for warning in warnings:  # before the hours that they may cost
            say(f"Warning: {warning}", error=True)
        placement = search(loaded, folder.checkpoint, folder.goes_on)
        _say_that_pictures_come(not no_pictures)
        failures = deliver(
            placement, folder, warnings=warnings, pictures=not no_pictures, meshes=not no_meshes,
            look=look,
        )  # fmt: skip
    _say_what_came(placement, directory, placement.warnings, failures)


def _warnings(study: Study) -> list[str]:
    from glvis.cli.wording import large_face_warnings, resolution_warnings, search_warnings
    from glvis.evaluation.checks import study_warnings

    return [
        *study_warnings(study),
        *search_warnings(study),
        *resolution_warnings(study),
        *large_face_warnings(study),
    ]


def _look(study: Study, colors: Sequence[str] | None, all_pictures: bool) -> Look:
    """Return how pictures are to look, or say what the study's sensors do not state."""
    from glvis.pictures.qualitycolors import check_kinds
    from glvis.reports.delivery import Look

    try:
        check_kinds(colors or (), study.sensors)
    except ValueError as error:
        raise StudyError(f"--{error}".replace(" = ", " ", 1)) from error
    return Look(also=tuple(colors or ()), all_pictures=all_pictures)


def _say_that_pictures_come(wanted: bool) -> None:
    from glvis.cli.terminal import say

    if wanted:
        say("Making the pictures ...", error=True)


def _say_what_came(
    placement: Placement, directory: Path, warnings: Sequence[str], failures: Sequence[str]
) -> None:
    """Tell a result and its files; exit code 1 if some of them failed."""
    from glvis.cli.terminal import say
    from glvis.cli.wording import result_lines
    from glvis.reports.delivery import left_out_lines, summary_of_files

    for line in result_lines(placement):
        say(line)
    for warning in [*warnings, *failures]:
        say(f"Warning: {warning}")
    say(summary_of_files(directory))
    for line in left_out_lines(directory):
        say(line)
    if failures:
        raise typer.Exit(1)

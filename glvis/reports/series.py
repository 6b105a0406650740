"""Many runs of one study in one folder: run one after the other, resumed, summed up.

Each run is an ordinary result in a folder of its own. What is known of all of them is written
again after each one; the index is there from the start, so that a killed series can go on.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from glvis.common.complaints import checked
from glvis.errors import StudyError
from glvis.problem.study import Study
from glvis.reports.delivery import deliver
from glvis.reports.series_tables import FILES, write_series
from glvis.results.folder import (
    INDEX,
    OWN,
    RENEWAL,
    SERIES,
    STAGING,
    STUDY,
    can_resume,
    manifest,
    read_index,
    result_folder,
    series_index,
    settle_folder,
)
from glvis.results.indexes import SeriesIndex
from glvis.results.journal import (
    machine_errors,
    put_in_place,
    refuse_links,
    remove_files,
    remove_if_empty,
    write_whole,
)
from glvis.results.lock import held
from glvis.results.spread import Spread, outcomes_of
from glvis.results.vary import Plan, PlannedRun, plan_runs
from glvis.search.placement import INTERRUPTED, Placement
from glvis.study.loading import load_study

# Searches a study, with the file of its state and whether to go on from there.
Search = Callable[[Study, Path, bool], Placement]


def read_series(directory: Path, repeats: int | None = None) -> Plan:
    """Return the plan of a series that was begun.

    Parameters
    ----------
    directory : Path
        Its folder.
    repeats : int, optional
        Runs of each point from now on; as many as before, or more.

    Raises
    ------
    StudyError
        If there is no series, its study cannot be run any more, or there would be fewer repeats.
    """
    path = series_index(directory)
    if path is None:
        raise StudyError(f"{directory}: holds no series of runs")
    try:
        index = checked(SeriesIndex, read_index(path))
    except StudyError:
        raise
    except ValueError as error:
        raise StudyError(f"{path}: is no series of glvis: {error}") from None
    before = index.repeats
    study = replace(load_study(directory / STUDY), title=index.title, vary=index.vary)
    if repeats is not None and repeats < before:
        raise StudyError(f"{directory}: has {before} repeats, --repeats can only add to them")
    return plan_runs(study, repeats=repeats or before)


@contextmanager
def series_folder(
    directory: Path, plan: Plan, text: str, *, overwrite: bool = False
) -> Iterator[None]:
    """Write what a series begins with; it goes again if its first run does not even begin.

    Parameters
    ----------
    directory : Path
        An existing folder, this process's own; see ``own_folder``.
    plan : Plan
        All runs.
    text : str
        The study without its ``[vary]``.
    overwrite : bool
        Take the place of a series that is there.

    Raises
    ------
    StudyError
        If the folder holds something that may not be replaced.
    MachineError
        If it cannot be written to.
    """
    staging = directory / RENEWAL
    with machine_errors(directory):
        _refuse_what_is_there(directory, overwrite)
        old = _files_of_series(directory)
        refuse_links(directory, old, [RENEWAL, STAGING])
        for left in (staging, directory / STAGING):  # by what was killed before it began
            shutil.rmtree(left, ignore_errors=True)
        staging.mkdir()
        write_whole(staging / STUDY, text)
        write_series(staging, plan)
        put_in_place(staging, directory, old, SERIES)
    try:
        yield
    except BaseException:
        if not any((directory / run.name).exists() for run in plan.runs):
            remove_files(directory, [*_heads(directory, FILES), STUDY])
        raise


def run_series(
    directory: Path,
    plan: Plan,
    search: Search,
    *,
    warnings: Callable[[Study], Sequence[str]],
    on_run: Callable[[PlannedRun], None] | None = None,
    meshes: bool = True,
) -> bool:
    """Run what has not finished yet; return whether all runs have now.

    Ctrl-C, SIGTERM and SIGHUP end the run in hand with a result, and the series with it.

    Parameters
    ----------
    directory : Path
        Folder of the series.
    plan : Plan
        Its runs.
    search : callable
        Finds a placement; see ``Search``.
    warnings : callable
        Says what to keep with the result of a study, before its search begins.
    on_run : callable, optional
        Is told each run before it begins.
    meshes : bool
        Whether each result has coloured meshes.

    Raises
    ------
    StudyError
        If a run cannot go on from where it was.
    MachineError
        Where there is no OpenGL, or the folder cannot be written to.
    """
    refuse_links(directory, (), [run.name for run in plan.runs])
    for run in plan.runs:
        settle_folder(directory / run.name)
    finished = {one.run.name for one in outcomes_of(directory, plan) if one.is_finished}
    for run in plan.runs:
        if run.name in finished:
            continue
        if on_run:
            on_run(run)
        resume = can_resume(directory / run.name)
        try:
            with result_folder(directory / run.name, resume=resume, series=directory) as folder:
                study = load_study(directory / STUDY, run.settings)
                if not folder.goes_on:
                    folder.keep_study(study.text)
                sentences = warnings(study)
                placement = search(study, folder.checkpoint, folder.goes_on)
                deliver(placement, folder, warnings=sentences, pictures=False, meshes=meshes)
            write_series(directory, plan)
        except KeyboardInterrupt:
            return False
        if placement.stop_reason.startswith(INTERRUPTED):
            return False
    return True


def best_runs(directory: Path, spreads: Sequence[Spread]) -> list[Path]:
    """Return the folders of the best run of each point."""
    return [directory / one.best.run.name for one in spreads if one.best]


def _refuse_what_is_there(directory: Path, overwrite: bool) -> None:
    """Raise if a new series may not have this folder."""
    if directory.exists() and not directory.is_dir():
        raise StudyError(f"{directory}: is a file; the results need a folder")
    inside = {entry.name for entry in directory.iterdir()} - {*OWN}
    if can_resume(directory):  # the search of one run
        inside.add(INDEX)
    index = series_index(directory)
    if index:
        read_index(index)  # or it is somebody else's
        if not overwrite:
            raise StudyError(
                f"{directory}: holds a series of runs already; go on with it by "
                f"--resume {directory}, or start anew with --overwrite"
            )
    elif inside:
        what = "the result of one run" if INDEX in inside else "no series of glvis"
        raise StudyError(f"{directory}: is not empty and holds {what}; choose another folder")


def _files_of_series(directory: Path) -> list[str]:
    """Return the files of the series in a folder and of its runs; what is unfinished goes."""
    names = [*_heads(directory, (*FILES, STUDY))] if series_index(directory) else []
    for path in sorted(directory.glob("run-[0-9][0-9]*")) if names else ():
        refuse_links(directory, (), [path.name])
        if path.is_dir():
            settle_folder(path)
            with held(path):
                shutil.rmtree(path / STAGING, ignore_errors=True)
            names += [f"{path.name}/{name}" for name in manifest(path)]
            remove_if_empty(path)
    return names


def _heads(directory: Path, names: Sequence[str]) -> list[str]:
    """Return which files are there, and what a kill has left of them."""
    return [name for own in names for name in (own, f"{own}.part") if (directory / name).exists()]

"""Many searches by one command: repeats and varied keys, and what is said on the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from glvis.common.hints import command
from glvis.errors import MachineError, StudyError

if TYPE_CHECKING:
    from glvis.problem.study import Study
    from glvis.reports.series import Search
    from glvis.results.vary import Plan, PlannedRun
    from glvis.search.placement import Placement


def planned_runs(study: Study, settings: Sequence[str] = ()) -> list[str]:
    """Return lines about the runs of a study; none where it has no ``[vary]``."""
    from glvis.cli.series_words import plan_lines
    from glvis.results.vary import plan_runs

    return ["", *plan_lines(plan_runs(study, settings))] if study.vary else []


def optimize_many(
    directory: Path | None,
    study: Study | None,
    settings: Sequence[str],
    search: Search,
    *,
    options: Sequence[str],
    repeats: int | None,
    dry_run: bool,
    resume: bool,
    extend: int,
    overwrite: bool,
    warnings: Callable[[Study], list[str]],
    pictures: bool,
    all_pictures: bool,
    colors: Sequence[str],
    meshes: bool,
) -> None:
    """Do what ``optimize`` does, for many runs; exit code 1 where pictures failed."""
    from glvis.cli.series_words import plan_lines
    from glvis.cli.terminal import say
    from glvis.reports.series import read_series, run_series, series_folder
    from glvis.results.folder import own_folder
    from glvis.results.vary import plan_runs

    if extend:
        raise StudyError("--extend adds to one search: --resume the folder of that run")
    if resume and (study or settings or options or overwrite):
        raise StudyError(
            "--resume: a series goes on with its own study; only --repeats can add runs to it"
        )
    if resume:
        assert directory
        plan = read_series(directory, repeats)
    else:
        assert study
        plan = plan_runs(study, settings, options, repeats or 1)
    if dry_run:
        for line in plan_lines(plan):
            say(line)
        return
    assert directory
    teller = _Teller(plan, search, warnings)
    run_all = partial(
        run_series,
        directory,
        plan,
        teller.search,
        warnings=teller.warnings,
        on_run=teller.begins,
        meshes=meshes,
    )
    with own_folder(directory):
        if resume:
            done = run_all()
        else:
            assert study
            with series_folder(directory, plan, study.text, overwrite=overwrite):
                done = run_all()
        _finish(directory, plan, pictures and done, all_pictures, colors)


class _Teller:
    """Says what a series does, run by run, on standard error."""

    def __init__(self, plan: Plan, search: Search, warnings: Callable[[Study], list[str]]) -> None:
        self._plan, self._search, self._warnings = plan, search, warnings
        self._said: set[str] = set()

    def begins(self, run: PlannedRun) -> None:
        from glvis.cli.series_words import run_line
        from glvis.cli.terminal import say

        say(run_line(self._plan, run), error=True)

    def warnings(self, study: Study) -> list[str]:
        found = self._warnings(study)
        self._say(found)
        return found

    def search(self, study: Study, checkpoint: Path, resume: bool) -> Placement:
        from glvis.cli.terminal import say

        placement = self._search(study, checkpoint, resume)
        kind = study.objective.label
        say(f"{kind} = {placement.value:.6g}, {placement.stop_reason}", error=True)
        self._say(placement.warnings)
        return placement

    def _say(self, sentences: Sequence[str]) -> None:
        from glvis.cli.terminal import say

        for sentence in sentences:
            if sentence not in self._said:
                say(f"Warning: {sentence}", error=True)
                self._said.add(sentence)


def _finish(
    directory: Path, plan: Plan, pictures: bool, all_pictures: bool, colors: Sequence[str]
) -> None:
    """Draw what is known, make the pictures of the best runs, and say it all."""
    from glvis.cli.series_words import series_lines
    from glvis.cli.terminal import say
    from glvis.reports.delivery import VIEWS, Look, left_out_lines, render_again
    from glvis.reports.series import best_runs
    from glvis.reports.series_tables import write_plot, write_series

    spreads = write_series(directory, plan)
    write_plot(directory, plan, spreads)
    failures = []
    for path in best_runs(directory, spreads) if pictures else []:
        if (path / VIEWS).is_dir():
            continue
        say(f"Making the pictures of {path.name} ...", error=True)
        try:
            render_again(path, Look(also=tuple(colors), all_pictures=all_pictures))
            for line in left_out_lines(path):
                say(line, error=True)
        except KeyboardInterrupt:
            failures.append(
                f"pictures were left out on Ctrl-C; {command('render', path)} makes them"
            )
            break
        except MachineError as error:
            failures.append(f"the pictures of {path} could not be made: {error}")
    for line in series_lines(plan, spreads, directory):
        say(line)
    for failure in failures:
        say(f"Warning: {failure}")
    if failures:
        raise typer.Exit(1)

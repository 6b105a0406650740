"""The page "The paper, reproduced": the paper's Tables 6, 7, 9 and 11 beside our runs of them.

The paper's numbers are data below, each with its table; ours are read from results and never
typed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from casestudies import SCENES

from glvis.cli.terminal import duration
from glvis.problem.scene import Model
from glvis.problem.visibility_options import VisibilityOptions
from glvis.results.result import sha256, versions
from glvis.results.tables import ModelRow, mean_row, model_rows
from glvis.results.within_reach import reach_rows
from glvis.search.placement import Placement, evaluate_poses

# Table 5, Table 6 and the text of Sec. 3.1 and 3.2.
PARTICLES, MOST_ITERATIONS, STALL = 300, 200, 30
ITERATIONS, HOURS, SECONDS = 76, 41.3, 6.44
# Table 7: ring -> (Z in mm, alpha, beta in degrees).
TABLE_7 = {1: (136, 54, 14), 2: (-136, 44, 38)}
# Table 9: (observed by all cameras, unique, triangles, percentage as printed), models 1 to 6.
TABLE_9 = (
    (13062, 7867, 7985, 98.5),
    (14613, 8254, 8341, 99.0),
    (13790, 8647, 8767, 98.6),
    (13508, 8590, 8726, 98.4),
    (12925, 8632, 8830, 97.7),
    (12487, 8198, 8409, 97.5),
)
OVERLAP = "about 40"  # percent of the model seen by more than one camera, text of Sec. 3.1
# Table 11: sensors -> (observed by all, its deviation, unique, its deviation, percentage), of 6500.
TABLE_11 = {
    2: (6882, 321, 5198, 66, 80),
    3: (8163, 1535, 5412, 120, 83),
    4: (9769, 1152, 5823, 90, 90),
}

ARM = "arm5"  # whose pictures are shown
PICTURES = (
    (
        "arms",
        f"{ARM}-sensor-perspective",
        "Who sees which face of an arm, and from where (Fig. 15)",
    ),
    ("arms", f"{ARM}-sensor-sides", "The same from four sides (Fig. 16)"),
    ("arms", f"{ARM}-overlap-sides", "How many sensors see each face"),
    ("arms", f"{ARM}-unseen", "What nobody sees, from the two sides that show most of it"),
    ("arms", "convergence", "The search"),
    ("kitchen-2", "kitchen-sensor-perspective", "The kitchen with two sensors (Fig. 18)"),
    ("kitchen-3", "kitchen-sensor-perspective", "With three (Fig. 19)"),
    ("kitchen-4", "kitchen-sensor-perspective", "With four (Fig. 20)"),
    ("kitchen-4", "kitchen-unseen", "What the four do not see"),
)

DIFFERENCES = """\
- **Other meshes.** The paper's six scanned arms and its reduction of the BlenSor kitchen are not
  public. Ours are made from formulas (see [scenes](README.md)): about as many faces, but
  other bodies and other furniture. Percentages of different meshes cannot be compared closely: the
  fingers are complete here and were cut in the paper, and of a kitchen's faces a part looks at the
  floor or into a corner where no sensor can be. "Reachable" says how much some allowed pose sees.
- **What counts as seen.** A face is seen here if a pixel shows it, by the true ray; faces that are
  turned away or seen too obliquely still hide what lies behind them, and so does what is nearer
  than the working range. The paper asks for the centre of mass, measures incidence against the
  optical axis with 20 degrees of tolerance, and takes refused faces away before it looks for what
  hides. So it sees more of the arms, and less of the kitchen, of whose large faces a part may show
  and the centre not. `--set 'visibility.semantics="paper"'` has all of that;
  "by its rules" is what the same layout, found by ours, sees by the paper's.
- **One viewpoint.** The D415 measures depth where both of its imagers see; the paper has one
  pinhole, and so has this page. [What remains with both](second-imager.md).
- **The objective.** The paper minimises 1/OF3, glvis maximises OF3: the same order. Its three terms
  count faces here and are divided by the number of faces, so that every model weighs alike.
- **The bounds.** The paper calls them plausible and does not print them; those in
  [arm.toml](arm.toml) are ours. The rings have the 300 mm of Table 8, not the 250 mm of
  the text.
- **The kitchen's sensors** may stand anywhere in the room here, as the paper has it, also inside a
  cupboard: such a place sees little, and the search leaves it.
- **Time.** The paper's is that of MATLAB with ray tracing on a GPU of 2020, ours that of the named
  OpenGL driver; they say what a user waits, not which method is better.
"""


@dataclass(frozen=True, eq=False)
class Run:
    """A finished run: what it found, its folder, and whether its swarm was a small one."""

    placement: Placement
    folder: Path
    is_quick: bool


def wanted_pictures() -> Iterator[tuple[str, str, str]]:
    """Yield case, name of a view and caption of the pictures on the page."""
    yield from PICTURES


def page_lines(
    runs: Mapping[str, Sequence[Run]], pictures: Sequence[tuple[str, str]]
) -> Iterator[str]:
    """Yield the page, Markdown.

    Parameters
    ----------
    runs : dict of str to sequence of Run
        By case, a key of ``casestudies.STUDIES``; empty where nothing was run.
    pictures : sequence of (str, str)
        File in ``pictures/`` and caption.
    """
    yield "# The paper, reproduced"
    yield ""
    yield "Buonamici et al. 2020, Sec. 3, beside the same studies run by glvis. All of this page is"
    yield "written by `tools/reproduce.py` from results of its runs; no number of ours is typed."
    yield ""
    yield from _arm_lines(runs)
    yield from _kitchen_lines(runs)
    yield "## What differs, and why"
    yield ""
    yield from DIFFERENCES.splitlines()
    if pictures:
        yield ""
        yield "## Pictures"
        yield ""
        for name, caption in pictures:
            yield f"![{caption}](pictures/{name})"
            yield ""
            yield f"*{caption}*"
            yield ""


def _arm_lines(runs: Mapping[str, Sequence[Run]]) -> Iterator[str]:
    yield "## The arm scanner (Sec. 3.1)"
    yield ""
    if not runs["arms"]:
        yield from ("Not run yet: `tools/reproduce.py --only arms`.", "")
        return
    run = runs["arms"][0]
    yield from _made_by(runs["arms"], "arms")
    yield from _table_6(run)
    yield from _table_7(run.placement)
    yield from _table_9(run.placement, [r.placement for r in runs["arms-table-8"]])


def _table_6(run: Run) -> Iterator[str]:
    """Yield how the search went; times only where the settings are those of the paper."""
    found, last = run.placement, run.placement.trace[-1]
    swarm, objective = found.study.swarm, found.study.objective
    maps = len(found.study.sensors) * len(found.study.models)
    rows: list[tuple[str, str, str]] = [
        ("particles", f"{PARTICLES}", f"{swarm.particles}"),
        ("iterations at most", f"{MOST_ITERATIONS}", f"{swarm.iterations}"),
        ("iterations done", f"{ITERATIONS}", f"{last.iteration}"),
        ("why it ended", f"stalled for {STALL}, it seems", found.stop_reason),
        ("maps an evaluation", f"{maps}", f"{maps}"),
        ("maps rendered", f"{(ITERATIONS + 1) * PARTICLES * maps:,}", f"{found.maps_rendered:,}"),
        (
            f"OF3 at the start, at the end (at most {objective.upper_bound:g})",
            "not told",
            f"{found.start_value:.2f}, {found.value:.2f}",
        ),
    ]
    if not run.is_quick:
        each = last.seconds / last.evaluations
        rows += [
            ("time of an evaluation", f"{SECONDS:g} s", f"{1000 * each:.1f} ms"),
            ("time of the search", f"{HOURS:g} h", duration(last.seconds)),
        ]
    yield "**Table 6: the search**"
    yield ""
    yield from _table(("", "paper", "glvis"), rows)
    yield ""


def _table_7(found: Placement) -> Iterator[str]:
    """Yield the two rings."""
    names = [variable.name for variable in found.study.variables]
    ours = dict(zip(names, found.position, strict=True))
    yield "**Table 7: the two rings**"
    yield ""
    header = ("ring", "paper: Z mm", "α", "β", "glvis: Z mm", "α", "β")
    rows = [
        (
            f"{ring}",
            *(f"{value:g}{unit}" for value, unit in zip(theirs, ("", "°", "°"), strict=True)),
            f"{ours[f'z{ring}']:.0f}",
            f"{ours[f'alpha{ring}']:.0f}°",
            f"{ours[f'beta{ring}']:.0f}°",
        )
        for ring, theirs in TABLE_7.items()
    ]
    yield from _table(header, rows)
    yield ""


def _table_9(found: Placement, fixed: Sequence[Placement]) -> Iterator[str]:
    """Yield what is seen of each arm, by the found layout and by that of Table 8."""
    rows = _rows(found)
    reach = reach_rows(found.study.models, found.maps, found.reach) if found.reach else [None] * 7
    header = (
        "model", "paper: by all", "unique", "faces", "seen",
        "glvis: by all", "unique", "faces", "seen", "by its rules", "by 2+", "reachable",
    )  # fmt: skip
    body, lenient = [], _by_its_rules(found)
    for number, (theirs, row, could) in enumerate(zip(TABLE_9, rows, reach, strict=False), 1):
        total, unique, faces, printed = theirs
        body.append(
            (f"{number}", f"{total:,}", f"{unique:,}", f"{faces:,}", f"{printed:.1f} %",
             f"{row.seen_by_all_cameras:,}", f"{row.unique_seen:,}", f"{row.total:,}",
             f"{row.percentage:.1f} %", f"{lenient[number - 1]:.1f} %",
             f"{100 * row.shares_seen_by[1]:.1f} %",
             f"{could.percentage:.1f} %" if could else "")
        )  # fmt: skip
    mean, paper = mean_row(rows), np.mean(TABLE_9, axis=0)
    body.append(
        ("mean", f"{paper[0]:,.0f}", f"{paper[1]:,.0f}", f"{paper[2]:,.0f}", f"{paper[3]:.1f} %",
         f"{mean['seen_by_all_cameras']:,.0f}", f"{mean['unique_seen']:,.0f}",
         f"{mean['total']:,.0f}", f"{mean['percentage']:.1f} %", f"{np.mean(lenient):.1f} %",
         f"{100 * mean['share_seen_by_2']:.1f} %",
         f"{reach[-1].percentage:.1f} %" if reach[-1] else "")
    )  # fmt: skip
    yield "**Table 9: faces seen**"
    yield ""
    yield from _table(header, body)
    yield ""
    yield f"By more than one camera the paper has {OVERLAP} % of a model."
    if fixed:
        theirs = mean_row(_rows(fixed[0]))
        yield (
            f"The paper's own poses (Table 8) see {theirs['percentage']:.1f} % of these arms "
            f"(the mean), OF3 = {fixed[0].value:.2f}: they were found for others."
        )
    yield ""


def _kitchen_lines(runs: Mapping[str, Sequence[Run]]) -> Iterator[str]:
    yield "## The kitchen (Sec. 3.2)"
    yield ""
    done = {n: runs[f"kitchen-{n}"] for n in TABLE_11 if runs[f"kitchen-{n}"]}
    if not done:
        yield from ("Not run yet: `tools/reproduce.py --only kitchen`.", "")
        return
    yield from _made_by([run for found in done.values() for run in found], "kitchen")
    header = (
        "sensors", "paper: by all", "unique", "of 6500",
        "glvis: runs", "by all", "unique", "faces", "seen", "best", "by its rules", "reachable",
    )  # fmt: skip
    body = []
    for n, found in done.items():
        total, total_std, unique, unique_std, percentage = TABLE_11[n]
        rows = [_rows(run.placement)[0] for run in found]
        reach = found[0].placement.reach
        study, maps = found[0].placement.study, found[0].placement.maps
        could = reach_rows(study.models, maps, reach)[0].percentage if reach else None
        body.append(
            (f"{n}", f"{total:,} [{total_std:,}]", f"{unique:,} [{unique_std}]", f"{percentage} %",
             f"{len(rows)}{' quick' if found[0].is_quick else ''}",
             _spread([row.seen_by_all_cameras for row in rows]),
             _spread([row.unique_seen for row in rows]), f"{rows[0].total:,}",
             f"{np.mean([row.percentage for row in rows]):.1f} %",
             f"{max(row.percentage for row in rows):.1f} %",
             f"{np.mean([_by_its_rules(run.placement) for run in found]):.1f} %",
             "" if could is None else f"{could:.1f} %")
        )  # fmt: skip
    yield "**Table 11: faces seen, the mean over runs and in brackets the standard deviation**"
    yield ""
    yield from _table(header, body)
    yield ""


def _made_by(runs: Sequence[Run], part: str) -> Iterator[str]:
    """Yield which command and settings made some runs, and on what; the paper's settings first."""
    for is_quick in (False, True):
        some = [run for run in runs if run.is_quick == is_quick]
        if not some:
            continue
        found = some[0].placement
        swarm, is_shipped = found.study.swarm, all(map(_is_shipped, found.study.models))
        command = f"tools/reproduce.py{' --quick' if is_quick else ''} --only {part}"
        repeats = max(Counter(run.placement.study.title for run in some).values())
        command += f" --repeats {repeats}" if part == "kitchen" else ""
        command += "" if is_shipped else " --data DIR"
        if is_quick:
            yield "**Quick runs, not the paper's settings**: they show that the study runs, not"
            yield "what it finds."
        yield (
            f"Made by `{command}` (glvis {versions()['glvis']}, {found.gl.renderer}, "
            f"{found.workers} {'process' if found.workers == 1 else 'processes'}): "
            f"{swarm.particles} particles, up to {swarm.iterations} iterations, "
            f"`min_neighbors_fraction = {swarm.min_neighbors_fraction:g}`, on "
            f"{'the meshes of `scenes/`' if is_shipped else 'meshes from outside the repository'}."
        )
        yield ""


def _is_shipped(model: Model) -> bool:
    """Return whether a mesh is the one of that name in ``scenes/``."""
    own = SCENES / model.path.name if model.path else None
    return bool(own and model.path and own.is_file() and sha256(own) == sha256(model.path))


def _rows(found: Placement) -> list[ModelRow]:
    return model_rows(found.study.models, found.maps, found.study.objective)


def _by_its_rules(found: Placement) -> list[float]:
    """Return the percentage of each model that a layout sees by the paper's own rules."""
    study = replace(found.study, visibility=VisibilityOptions.paper())
    maps = evaluate_poses(study, found.camera_to_world).maps
    return [100 * seen.coverage for seen in maps]


def _spread(values: Sequence[int]) -> str:
    """Return mean and, of several, the standard deviation of the sample."""
    mean = f"{np.mean(values):,.0f}"
    return f"{mean} [{np.std(values, ddof=1):,.0f}]" if len(values) > 1 else mean


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield a Markdown table, numbers to the right."""
    yield f"| {' | '.join(header)} |"
    yield f"| --- |{' ---: |' * (len(header) - 1)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"

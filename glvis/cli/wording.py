"""Studies and results in words and tables of text, as the command line prints them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from glvis.cli.terminal import duration, table
from glvis.errors import MachineError
from glvis.evaluation.checks import Told, said_once
from glvis.problem.field import lens_words, partner_words
from glvis.problem.pieces import pieces_words
from glvis.problem.study import Study
from glvis.problem.swarm_options import SwarmOptions
from glvis.problem.visibility_options import render_resolution
from glvis.problem.winding import is_closed
from glvis.results.quality_tables import (
    has_quality_columns,
    interference_words,
    quality_table,
)
from glvis.results.tables import mean_row, model_rows, sensor_table
from glvis.results.within_reach import reach_table, reach_words
from glvis.search.estimate import (
    Cost,
    LargeFaces,
    large_faces,
    share_below_a_pixel,
    working_distance,
)
from glvis.search.placement import Placement

_MANY_BELOW_A_PIXEL = 0.05
_MANY_PIXELS = 1 << 24  # of an image that decides
_FEW_POINTS = 0.03  # of the area, that both criteria may differ by


def study_lines(study: Study) -> Iterator[str]:
    """Yield what a study is made of."""
    unit = study.unit
    yield f"{study.title} (lengths in {unit}, angles in degrees)"
    yield ""
    yield "Models and obstacles"
    header = ("", "mesh", "faces", f"area [{unit}²]", f"mean edge [{unit}]", "surface")
    meshes = [("model", m) for m in study.models] + [("obstacle", m) for m in study.obstacles]
    yield from table(
        header,
        [
            (what, m.name, m.n_faces, float(m.areas.sum()), m.mean_edge,
             "closed" if is_closed(m) else "open")
            for what, m in [(what, m.file) for what, m in meshes]
        ],
    )  # fmt: skip
    for model in study.models:
        if model.pieces:
            yield f"  {pieces_words(model, unit)}"
    yield ""
    yield "Sensors"
    kinds = {sensor.name: sensor for sensor in study.sensors}
    for name, sensor in kinds.items():
        own = [n for n, s in zip(study.sensor_names, study.sensors, strict=True) if s is sensor]
        opening = np.degrees(sensor.lens.opening)
        kind = f" {words}" if (words := lens_words(sensor.lens)) else ""
        measured = " from its centre" if sensor.distance == "range" else ""
        beside = f"{partner_words(sensor)} beside, " if sensor.partner else ""
        yield (
            f"  {name}: {opening[0]:.4g} x {opening[1]:.4g} deg{kind}, {beside}"
            f"{sensor.resolution[0]} x {sensor.resolution[1]} pixels, "
            f"{sensor.min_distance:g} to {sensor.max_distance:g} {unit}{measured}, incidence up to "
            f"{np.degrees(sensor.max_incidence):.4g} deg; {len(own)} of them: {', '.join(own)}"
        )
    yield ""
    yield f"Render resolution (criterion '{study.visibility.criterion}')"
    yield from table(
        ("model", "sensor", "pixels", "faces below a pixel", "at distance"),
        [
            (model.name, sensor.name, f"{size[0]} x {size[1]}" if size else "none: by points",
             f"{100 * share_below_a_pixel(sensor, model, size or sensor.resolution):.1f} %",
             f"{working_distance(sensor):g} {unit}")
            for model in study.models
            for sensor in kinds.values()
            for size in [render_resolution(study.visibility, sensor)]
        ],
    )  # fmt: skip
    yield ""
    if study.variables:
        yield f"Variables ({len(study.variables)})"
        yield from table(
            ("name", "min", "max", "start", ""),
            [
                (v.name, float(v.min), float(v.max), float(v.start),
                 "periodic" if v.periodic else "")
                for v in study.variables
            ],
        )  # fmt: skip
    else:
        yield "Variables: none; the study can be evaluated, there is nothing to search"
    yield ""
    yield from _objective_lines(study)
    yield _search_line(study)


def search_warnings(study: Study) -> list[str]:
    """Return a sentence where options of the swarm stand in a study that another search runs."""
    options = replace(study.swarm, seed=SwarmOptions().seed)  # all methods have the seed
    if "search.method" not in study.assumed or options == SwarmOptions():
        return []
    method = study.search.method
    return [f"[swarm]: its options have no say in '{method}', which searches; name [search] method"]


def resolution_warnings(study: Study) -> list[str]:
    """Return a sentence for each sensor with huge images, and of models that pixels may miss."""
    huge = [
        f"{sensor.name}: each map is drawn with {size[0]} x {size[1]} pixels, which takes seconds "
        "and hundreds of megabytes; [visibility] resolution = 'auto' draws far fewer"
        for sensor in dict.fromkeys(study.sensors)
        for size in [render_resolution(study.visibility, sensor)]
        if size and size[0] * size[1] > _MANY_PIXELS
    ]
    found = []
    for model in study.models:
        shares = {
            sensor.name: share_below_a_pixel(sensor, model, resolution)
            for sensor in study.sensors
            for resolution in [render_resolution(study.visibility, sensor)]
            if resolution  # else points decide, and faces may be of any size
        }
        if not shares:
            break
        name, share = max(shares.items(), key=lambda item: item[1])
        if share > _MANY_BELOW_A_PIXEL:
            sentence = (
                f"{100 * share:.0f} % of the faces are smaller than a pixel of {name} at working "
                "distance and may be missed; use resolution = 'auto', a higher resolution or "
                "criterion = 'centroid', or a coarser mesh"
            )
            found.append(Told("below a pixel", model.name, sentence))
    return huge + said_once(found)


def large_face_warnings(study: Study) -> list[str]:
    """Return a sentence about the models whose large faces make what is seen a matter of luck."""
    try:
        found = large_faces(study)
    except MachineError:  # who draws for the study will say so
        return []
    return said_once(
        [
            Told(
                "large faces",
                one.model.name,
                f"{one.n_faces:,} {'pieces' if one.model.pieces else 'faces'} hold "
                f"{100 * one.area_share:.0f} % of the area and each counts whole: "
                f"{100 * one.by_pixels:.1f} % of the area would be seen by criterion = 'pixels', "
                f"{100 * one.by_centroid:.1f} % by 'centroid'; {_remedy(one, study.unit)}",
            )
            for one in found
            if one.difference > _FEW_POINTS
        ]
    )


def _remedy(found: LargeFaces, unit: str) -> str:
    if found.model.pieces:
        return f"set [scene] max_edge shorter than {found.model.pieces.max_edge:.2g} ({unit})"
    return f"set [scene] max_edge = 'auto', or a length such as {found.limit:.2g} ({unit})"


def cost_lines(cost: Cost, workers: int) -> Iterator[str]:
    """Yield what a run takes."""
    gl = cost.gl
    yield f"OpenGL: {gl.renderer}, {gl.version} ({gl.vendor}, by {gl.backend})"
    yield (
        f"One evaluation ({cost.maps} map{'s' * (cost.maps > 1)}): "
        f"{1000 * cost.evaluation_seconds:,.1f} ms in one process, the median of {cost.samples} "
        f"random position{'s' * (cost.samples > 1)}"
    )
    if cost.run_maps:
        yield (
            f"A full run of {cost.run_maps:,} maps: an estimated "
            f"{duration(cost.run_seconds(workers))} with {workers} processes, "
            f"{duration(cost.run_seconds())} with one; it may end before"
        )
        if cost.search_seconds:
            yield (
                f"  of which predictions take {duration(cost.search_seconds * cost.run_maps)} in "
                "one process, whatever the number of others"
            )
        yield (
            "  and after that up to "
            f"{duration(cost.reach_seconds(workers))} to sample what is within reach"
        )


def result_lines(placement: Placement) -> Iterator[str]:
    """Yield what a placement is worth."""
    study = placement.study
    rows = model_rows(study.models, placement.maps, study.objective)
    most = min(4, len(study.sensors))  # columns; the files have them all
    several = range(2, most + 1)
    columns = ("model", "seen by all", "unique", "total", "seen %", "area %")
    body: list[tuple[object, ...]] = [
        (
            row.name,
            row.seen_by_all_cameras,
            row.unique_seen,
            row.total,
            f"{row.percentage:.1f}",
            f"{row.area_percentage:.1f}",
            *(f"{100 * row.shares_seen_by[n - 1]:.1f}" for n in several),
        )
        for row in rows
    ]
    if len(rows) > 1:
        mean = mean_row(rows)
        body.append(
            (
                "mean",
                round(mean["seen_by_all_cameras"]),
                round(mean["unique_seen"]),
                round(mean["total"]),
                f"{mean['percentage']:.1f}",
                f"{mean['area_percentage']:.1f}",
                *(f"{100 * mean[f'share_seen_by_{n}']:.1f}" for n in several),
            )
        )
    yield "Faces seen"
    yield from table((*columns, *(f"by {n}+ %" for n in several)), body)
    yield ""
    if placement.reach:
        header, numbers = reach_table(placement, most)
        yield reach_words(placement.reach)
        yield from table(header, [[name, *map("{:.1f}".format, row)] for name, *row in numbers])
        yield ""
    yield from _sensor_lines(placement)
    yield ""
    kind = study.objective.label
    if not placement.trace:
        yield f"{kind} = {placement.value:.6g}"
        return
    yield f"{kind} = {placement.value:.6g} (start: {placement.start_value:.6g})"
    yield placement.stop_reason[:1].upper() + placement.stop_reason[1:]
    yield (
        f"{placement.evaluations:,} evaluations, {placement.maps_rendered:,} maps in "
        f"{duration(placement.seconds)} (seed {placement.seed})"
    )


def _sensor_lines(placement: Placement) -> Iterator[str]:
    study = placement.study
    noun, rows = sensor_table(study.models, placement.maps, study.objective.by_area)
    yield f"Sensors: what each sees, and what only it sees, in % of the {noun} (mean over models)"
    yield from table(
        ("sensor", "sees %", "only it %"),
        [(name, f"{seen:.1f}", f"{only_it:.1f}") for name, seen, only_it in rows],
    )
    if has_quality_columns(study.sensors):
        yield ""
        yield from quality_lines(placement)
    if words := interference_words(placement):
        yield ""
        yield words


def quality_lines(placement: Placement) -> Iterator[str]:
    """Yield how good the views of each sensor are."""
    yield "How good the views are: the median over the faces that each sensor sees, and what the"
    yield "worst of them exceed"
    yield from table(*quality_table(placement))


def _objective_lines(study: Study) -> Iterator[str]:
    objective = study.objective
    counted = "faces and pieces" if any(model.pieces for model in study.models) else "faces"
    what = "area" if objective.by_area else counted
    line = f"Objective: {objective.kind.upper()} by {what}"
    if objective.kind == "of3":
        line += f", {objective.w_tot:g} T_tot + {objective.w_of1:g} OF1 + {objective.w_of2:g} OF2"
    if objective.kind != "of1":
        line += f", overlap weights {', '.join(f'{w:g}' for w in objective.overlap)}"
        line += ", normalised" if objective.normalize else ", raw counts"
    if len(study.models) > 1:
        line += f"; {objective.aggregate} over {len(study.models)} models"
    yield line + _assumed(study, "objective.kind")


def _search_line(study: Study) -> str:
    method, swarm = study.search.method, study.swarm
    line = f"Search: {method}"
    if method == "swarm":
        line += f", {swarm.particles} particles, up to {swarm.iterations} iterations"
    return f"{line}, seed {swarm.seed}" + _assumed(study, "search.method")


def _assumed(study: Study, key: str) -> str:
    return f" (by default: the study does not say {key})" if key in study.assumed else ""

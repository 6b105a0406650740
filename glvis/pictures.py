"""The pictures of a result: which sensor sees what, how often, how well, and what nobody sees.

Each function makes one sheet; ``write_views`` makes them all, with names one can guess.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glvis.camera import rigid_inverse
from glvis.coloring import (
    KINDS,
    Bar,
    Coloring,
    Swatch,
    back_swatch,
    coloring,
    obstacle_swatch,
    ramp_colors,
    seen_by_one,
    share,
)
from glvis.framing import View, axis_label, towards_eye
from glvis.palette import rgb
from glvis.places import Box, grid
from glvis.plots import TraceLike, write_convergence
from glvis.sheet import Sheet
from glvis.stage import Stage
from glvis.study import Study
from glvis.visibility import VisibilityMap

Colors = NDArray[np.uint8]

SIZE = (1600, 1000)
_HEAT_RELIEF = 0.55  # light and shade must not be taken for a value
_STRIP = 58  # units under a picture for axes, title and scale bar
_NEARER, _FARTHER, _NOTHING = rgb("#6E7480"), rgb("#C3C8D0"), rgb("#FFFFFF")
_SURROUNDED = ("sensor", "overlap")  # colours that are also shown with the rig, from four sides


def write_views(
    study: Study,
    camera_to_world: ArrayLike,
    maps: Sequence[VisibilityMap],
    directory: Path,
    *,
    trace: Sequence[TraceLike] = (),
    start_value: float | None = None,
    size: tuple[int, int] = SIZE,
    view: tuple[float, float] | None = None,
    color: str | None = None,
) -> list[Path]:
    """Write the pictures of placed sensors as PNG.

    For each model MODEL: ``MODEL-sensor-perspective``, ``MODEL-sensor-sides``,
    ``MODEL-overlap-perspective``, ``MODEL-overlap-sides``, ``MODEL-incidence``,
    ``MODEL-distance``, ``MODEL-unseen`` and ``MODEL-contact``. For each sensor NAME, looking at
    the first model: ``sensor-NAME`` and ``sensor-NAME-depth``. With a trace: ``convergence``.

    Parameters
    ----------
    study : Study
        What was run.
    camera_to_world : (S, 4, 4) float64
        Poses of the sensors.
    maps : sequence of VisibilityMap
        One a model.
    directory : Path
        An existing folder.
    trace : sequence of TraceRow
        Steps of the search; may be empty.
    start_value : float, optional
        Value of the user's start, for the plot.
    size : tuple of int
        Pixels (width, height).
    view : (float, float), optional
        Azimuth and elevation, degrees, that pictures in perspective are taken from; see
        ``framing``.
    color : str, optional
        Only the pictures of the scene with this colouring, one of ``coloring.KINDS``.

    Returns
    -------
    list of Path
        The files, in the order made.

    Raises
    ------
    ValueError
        If ``color`` is none of them, there is not one map a model, or the size is too small.
    """
    if color is not None and color not in KINDS:
        raise ValueError(f"color = '{color}' must be one of {', '.join(KINDS)}")
    if len(maps) != len(study.models):
        raise ValueError(f"{len(study.models)} models need as many maps, got {len(maps)}")
    if min(size) < 200:
        raise ValueError(f"size = {size[0]} x {size[1]} must be at least 200 x 200 pixels")
    paths: list[Path] = []
    # One thread draws while another packs what is drawn.
    with Stage(study, camera_to_world) as stage, ThreadPoolExecutor(max_workers=1) as pool:
        pending: list[Future[None]] = []

        def write(name: str, sheet: Sheet) -> None:
            paths.append(directory / f"{name}.png")
            pending.append(pool.submit(sheet.save, paths[-1]))
            while len(pending) > 4:  # sheets are large
                pending.pop(0).result()

        for m, seen_map in enumerate(maps):
            seen, name = stage.show(m, seen_map), study.models[m].name
            for kind in [color] if color else KINDS:
                painted = coloring(kind, seen)
                stage.paint(painted.colors)
                if kind in _SURROUNDED:
                    write(
                        f"{name}-{kind}-perspective", perspective_sheet(stage, painted, size, view)
                    )
                    write(f"{name}-{kind}-sides", sides_sheet(stage, painted, size, view))
                else:
                    write(f"{name}-{kind}", close_sheet(stage, painted, size, view))
            if color is None and study.sensors:
                write(f"{name}-contact", contact_sheet(stage, size))
                if m == 0:
                    for s, sensor_name in enumerate(seen_map.sensor_names):
                        write(f"sensor-{sensor_name}", sensor_sheet(stage, s, size))
                        write(f"sensor-{sensor_name}-depth", depth_sheet(stage, s, size))
        for future in pending:
            future.result()
    if trace and color is None:
        paths.append(directory / "convergence.png")
        objective = study.objective
        write_convergence(
            paths[-1],
            trace,
            title=study.title or "Search",
            quantity=f"objective {objective.kind.upper()}, {objective.aggregate} over the models"
            if len(study.models) > 1
            else f"objective {objective.kind.upper()}",
            start_value=start_value,
            upper_bound=objective.upper_bound,
            size=size,
        )
    return paths


def perspective_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the scene with its sensors and their frusta, large."""
    sheet, box = _prepared(stage, painted, size)
    view = _directed(stage.views()["perspective"], direction)
    _panel(sheet, box, stage, view, with_rig=True, with_frusta=True)
    return sheet


def sides_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the scene with its sensors from top, front and side, and the model from behind."""
    sheet, box = _prepared(stage, painted, size)
    views = stage.views()
    far_side = stage.other_side(_directed(views["perspective"], direction))
    cells = grid(box, 2, 2, sheet.units(12))
    wanted = [*(views[k] for k in ("top", "front", "side")), far_side]
    for cell, view in zip(cells, wanted, strict=True):
        _panel(sheet, cell, stage, view, with_rig=view.is_parallel)
    return sheet


def close_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the model alone, filling the picture, from the two sides that show most of it."""
    sheet, box = _prepared(stage, painted, size)
    first = _directed(stage.views()["perspective"], direction)
    views = [first, stage.other_side(first)]
    gap = sheet.units(12)

    def scale(cells: list[Box]) -> float:
        return min(
            stage.eye(view, frame.size, with_rig=False).pixels_per_length(frame.size)
            for view, frame in zip(views, (_without_strip(sheet, c) for c in cells), strict=True)
        )

    cells = max((grid(box, 2, 1, gap), grid(box, 1, 2, gap)), key=scale)
    relief = _HEAT_RELIEF if painted.bar else 1.0
    for cell, view in zip(cells, views, strict=True):
        _panel(sheet, cell, stage, view, relief=relief)
    return sheet


def sensor_sheet(stage: Stage, s: int, size: tuple[int, int] = SIZE) -> Sheet:
    """Return the view through sensor ``s`` at its own aspect, coloured by what it sees."""
    painted = seen_by_one(stage.seen, s, stage.colors)
    sheet, box, column = _sensor_page(stage, s, painted, size)
    stage.paint(painted.colors)
    sheet.paste(stage.picture(stage.sensor_eye(s), box.size), box.x, box.y)
    sheet.frame(box, tuple(stage.colors[s].tolist()), max(2, sheet.units(3)))
    sheet.legend(column, painted, _neutral_rows(stage))
    return sheet


def depth_sheet(stage: Stage, s: int, size: tuple[int, int] = SIZE) -> Sheet:
    """Return the depth that sensor ``s`` measures, along its optical axis."""
    sensor, name, unit = stage.study.sensors[s], stage.seen.map.sensor_names[s], stage.study.unit
    low, high = sensor.min_distance, sensor.max_distance
    painted = Coloring(
        f"{name}: the depth it measures",
        np.zeros((0, 4), dtype=np.uint8),
        [
            *([Swatch(_NEARER, f"nearer than {low:g} {unit}")] if low > 0 else []),
            Swatch(_FARTHER, f"beyond {high:g} {unit}"),
            Swatch(_NOTHING, "nothing there"),
        ],
        Bar(low, high, "distance along the axis", unit),
    )
    sheet, box, column = _sensor_page(stage, s, painted, size)
    depth, samples = stage.depth(stage.sensor_eye(s), box.size)
    sheet.paste(_depth_picture(depth, samples, low, high), box.x, box.y)
    sheet.frame(box, tuple(stage.colors[s].tolist()), max(2, sheet.units(3)))
    sheet.legend(column, painted)
    return sheet


def contact_sheet(stage: Stage, size: tuple[int, int] = SIZE) -> Sheet:
    """Return the views through all sensors on one sheet."""
    seen, names = stage.seen, stage.seen.map.sensor_names
    sheet = Sheet(size)
    n = len(names)
    top = sheet.heading(
        f"{seen.model.name} · What each sensor sees",
        _subtitle(stage)
        + " · light grey is not counted"
        + (", dark grey is an obstacle" if stage.study.obstacles else ""),
    )
    margin, gap, caption = sheet.units(28), sheet.units(16), sheet.units(32)
    box = Box(margin, top, size[0] - 2 * margin, size[1] - top - margin)
    aspect = max(
        float(t[0] / t[1]) for t in (sensor.intrinsics.tan_half for sensor in stage.study.sensors)
    )

    def thumbnail(columns: int) -> tuple[int, int]:
        cell = grid(box, columns, math.ceil(n / columns), gap)[0]
        width = min(cell.width, int((cell.height - caption) * aspect))
        return max(width, 1), columns

    _, columns = max(map(thumbnail, range(1, n + 1)))
    for s, cell in enumerate(grid(box, columns, math.ceil(n / columns), gap)[:n]):
        tan = stage.study.sensors[s].intrinsics.tan_half
        width = min(cell.width, int((cell.height - caption) * tan[0] / tan[1]))
        height = max(1, int(width * tan[1] / tan[0]))
        picture = Box(cell.x + (cell.width - width) // 2, cell.y + caption, max(width, 1), height)
        painted = seen_by_one(seen, s, stage.colors)
        stage.paint(painted.colors)
        sheet.paste(stage.picture(stage.sensor_eye(s), picture.size), picture.x, picture.y)
        sheet.frame(picture, tuple(stage.colors[s].tolist()), max(2, sheet.units(2.5)))
        line = picture.y - sheet.units(7)
        value = share(seen.map.visible[s].mean())
        room = width - sheet.text_width(value, 17) - sheet.units(8)
        label = sheet.shortened(names[s], room, 19, bold=True)
        sheet.text(picture.x, line, label, size=19, bold=True, anchor="ls")
        sheet.text(picture.right, line, value, size=17, anchor="rs")
    return sheet


def _prepared(stage: Stage, painted: Coloring, size: tuple[int, int]) -> tuple[Sheet, Box]:
    """Return a sheet with heading and legend, and the room that is left for pictures."""
    sheet = Sheet(size)
    top = sheet.heading(f"{stage.seen.model.name} · {painted.title}", _subtitle(stage))
    margin, gap = sheet.units(28), sheet.units(26)
    extra = _neutral_rows(stage)
    width = sheet.legend_width([painted])
    column = Box(size[0] - margin - width, top, width, size[1] - top - margin)
    sheet.legend(column, painted, extra)
    return sheet, Box(margin, top, column.x - gap - margin, size[1] - top - margin)


def _neutral_rows(stage: Stage) -> list[Swatch]:
    """Return the legend's rows for what has no colour of its own."""
    backs = [] if stage.seen.model.is_closed else [back_swatch()]
    return [*backs, *([obstacle_swatch()] if stage.study.obstacles else [])]


def _subtitle(stage: Stage) -> str:
    """Return what the sheet is about, in a line."""
    seen, n = stage.seen, len(stage.study.sensors)
    faces = f"{seen.model.n_faces:,}".replace(",", " ")
    facts = f"{share(seen.map.coverage)} of {faces} faces seen by at least one of {n} sensors"
    if n == 1:
        facts = f"{share(seen.map.coverage)} of {faces} faces seen by the sensor"
    return " · ".join([*([stage.study.title] if stage.study.title else []), facts])


def _directed(view: View, direction: tuple[float, float] | None) -> View:
    """Return the view from another direction, if one is wanted."""
    return view if direction is None else View(view.name, *direction, is_parallel=False)


def _panel(
    sheet: Sheet,
    box: Box,
    stage: Stage,
    view: View,
    *,
    with_rig: bool = False,
    with_frusta: bool = False,
    relief: float = 1.0,
) -> None:
    """Draw the scene into a framed box, and under it axes, direction of view and scale bar."""
    frame = _without_strip(sheet, box)
    strip = box.height - frame.height
    eye = stage.eye(view, frame.size, with_rig=with_rig)
    picture = stage.picture(
        eye,
        frame.size,
        with_rig=with_rig,
        with_frusta=with_frusta,
        pixel=max(0.8, sheet.unit),
        relief=relief,
    )
    sheet.paste(picture, frame.x, frame.y)
    sheet.frame(frame)
    sheet.frame(box)
    per_length = eye.pixels_per_length(frame.size)
    if with_rig:
        places = eye.project(stage.poses[:, :3, 3], frame.size)
        clear = 1.05 * stage.body_size * per_length
        sheet.draw_labels(frame, places, stage.seen.map.sensor_names, stage.colors, clear)
    axes = rigid_inverse(eye.camera_to_world)[:3, :3]
    middle = frame.bottom + strip // 2
    sheet.triad(box.x + round(0.8 * strip), middle, round(0.68 * strip), axes)
    title = _view_title(stage, view)
    sheet.text(box.x + round(1.6 * strip), middle, title, size=16, anchor="lm")
    sheet.scale_bar(
        box.right - sheet.units(18),
        middle,
        per_length,
        round(0.22 * box.width),
        stage.study.unit,
        "" if eye.is_parallel else " in the middle",
    )


def _without_strip(sheet: Sheet, box: Box) -> Box:
    """Return the part of a box that is left above the strip for axes and scale bar."""
    strip = min(sheet.units(_STRIP), box.height // 3)
    return Box(box.x, box.y, box.width, box.height - strip)


def _view_title(stage: Stage, view: View) -> str:
    """Return where a view is from, in words and along which axis."""
    label = axis_label(towards_eye(stage.study.up, view.azimuth_deg, view.elevation_deg))
    if label:
        return f"{view.name}, from {label}"
    return f"from azimuth {view.azimuth_deg:g}°, elevation {view.elevation_deg:g}°".replace(
        "-", "−"
    )


def _sensor_page(
    stage: Stage, s: int, painted: Coloring, size: tuple[int, int]
) -> tuple[Sheet, Box, Box]:
    """Return a sheet of a sensor's own aspect, with heading, its picture's box and the legend's."""
    sensor = stage.study.sensors[s]
    blank = Sheet(size)
    margin, gap, legend = blank.units(28), blank.units(26), blank.legend_width([painted])
    top, bottom = blank.units(104), blank.units(40)
    tan = sensor.intrinsics.tan_half
    width = min(
        size[0] - 2 * margin - gap - legend, int((size[1] - top - bottom) * tan[0] / tan[1])
    )
    height = max(1, round(width * float(tan[1] / tan[0])))
    needed = max(height, blank.units(460))
    sheet = Sheet((2 * margin + gap + legend + width, top + needed + bottom), blank.unit)
    hfov, vfov = (math.degrees(v) for v in (sensor.intrinsics.hfov, sensor.intrinsics.vfov))
    pixels = f"{sensor.resolution[0]} x {sensor.resolution[1]} pixels".replace(" x ", " × ")
    sheet.heading(
        f"{painted.title} of {stage.seen.model.name}",
        f"{sensor.name} · {pixels} · {hfov:.4g}° × {vfov:.4g}° · "
        f"{sensor.min_distance:g} to {sensor.max_distance:g} {stage.study.unit}",
    )
    box = Box(margin, top, width, height)
    return sheet, box, Box(box.right + gap, top, legend, needed)


def _depth_picture(depth: NDArray[np.float64], samples: int, low: float, high: float) -> Colors:
    """Return depths as colours (H, W, 3), averaged over the samples of each pixel."""
    levels = 256
    table = np.vstack(
        [
            ramp_colors(np.linspace(low, high, levels), low, high),
            [_NEARER, _FARTHER, _NOTHING],
        ]
    )
    is_there = np.isfinite(depth)
    position = np.where(is_there, (depth - low) / (high - low), 0.0)
    index = np.clip(np.round(position * (levels - 1)), 0, levels - 1).astype(np.int64)
    index[depth < low] = levels
    index[depth > high] = levels + 1
    index[~is_there] = levels + 2
    height, width = depth.shape[0] // samples, depth.shape[1] // samples
    fine = table[index].reshape(height, samples, width, samples, 3)
    return np.round(fine.mean(axis=(1, 3))).astype(np.uint8)

"""Sheets of the scene: with its sensors large, from four sides, and the model alone.

Each function lays one model, painted already, on one sheet.
"""

from __future__ import annotations

from glvis.camera import rigid_inverse
from glvis.drawing.coloring import Coloring, Swatch, back_swatch, obstacle_swatch
from glvis.drawing.framing import View, axis_label, towards_eye
from glvis.drawing.places import Box, grid
from glvis.drawing.sheet import Sheet
from glvis.drawing.stage import Stage

SIZE = (1600, 1000)
_HEAT_RELIEF = 0.55  # light and shade must not be taken for a value
_STRIP = 58  # units under a picture for axes, title and scale bar


def perspective_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the scene with its sensors and their frusta, large."""
    view = _directed(stage, direction)
    return _laid_out(stage, painted, size, [view], (1,), with_frusta=True)


def sides_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the scene with its sensors from top, front and side, and the model from behind."""
    views, far_side = stage.views(), stage.other_side(_directed(stage, direction))
    wanted = [*(views[k] for k in ("top", "front", "side")), far_side]
    return _laid_out(stage, painted, size, wanted, (1, 2, 4))


def close_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the model alone, filling the picture, from the two sides that show most of it."""
    first = _directed(stage, direction)
    relief = _HEAT_RELIEF if painted.bar else 1.0
    views = [first, stage.other_side(first)]
    return _laid_out(stage, painted, size, views, (1, 2), relief=relief)


def neutral_rows(stage: Stage) -> list[Swatch]:
    """Return the legend's rows for what has no colour of its own."""
    backs = [] if stage.seen.model.is_closed else [back_swatch()]
    return [*backs, *([obstacle_swatch()] if stage.study.obstacles else [])]


def subtitle(stage: Stage) -> str:
    """Return what the sheet is about, in a line."""
    seen, n = stage.seen, len(stage.study.sensors)
    whole = "the area" if seen.model.pieces else f"{seen.model.n_faces:,} faces".replace(",", " ")
    who = "the sensor" if n == 1 else f"at least one of {n} sensors"
    facts = f"{seen.share(seen.map.counts > 0)} of {whole} seen by {who}"
    return " · ".join([*([stage.study.title] if stage.study.title else []), facts])


def _prepared(stage: Stage, painted: Coloring, size: tuple[int, int]) -> tuple[Sheet, Box]:
    """Return a sheet with heading and legend, and the room that is left for pictures."""
    sheet = Sheet(size)
    top = sheet.heading(f"{stage.seen.model.name} · {painted.title}", subtitle(stage))
    margin, gap = sheet.units(28), sheet.units(26)
    extra = neutral_rows(stage)
    width = sheet.legend_width([painted])
    column = Box(size[0] - margin - width, top, width, size[1] - top - margin)
    sheet.legend(column, painted, extra)
    return sheet, Box(margin, top, column.x - gap - margin, size[1] - top - margin)


def _directed(stage: Stage, direction: tuple[float, float] | None) -> View:
    """Return the view in perspective, from another direction if one is wanted."""
    view = stage.views()["perspective"]
    return view if direction is None else View(view.name, *direction, is_parallel=False)


def _laid_out(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int],
    views: list[View],
    columns: tuple[int, ...],
    *,
    with_frusta: bool = False,
    relief: float = 1.0,
) -> Sheet:
    """Return a sheet of views in the best of the numbers of columns."""
    sheet, box = _prepared(stage, painted, size)
    for cell, view in zip(_cells(sheet, box, stage, views, columns), views, strict=True):
        _panel(sheet, cell, stage, view, with_frusta=with_frusta, relief=relief)
    return sheet


def _panel(
    sheet: Sheet,
    box: Box,
    stage: Stage,
    view: View,
    *,
    with_frusta: bool,
    relief: float,
) -> None:
    """Draw the scene into a framed box, and under it axes, direction of view and scale bar."""
    with_rig = with_frusta or view.is_parallel
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
        centres = stage.poses[:, :3, 3]
        places = eye.project(centres, frame.size)
        clear = 1.05 * stage.body_size * per_length
        hidden = stage.is_hidden(centres, eye, frame.size)
        names = [
            f"({name})" if behind else name  # nobody shall take what is in front for the sensor
            for name, behind in zip(stage.seen.map.sensor_names, hidden, strict=True)
        ]
        sheet.draw_labels(frame, places, names, stage.colors, clear)
    axes = rigid_inverse(eye.camera_to_world)[:3, :3]
    middle = frame.bottom + strip // 2
    sheet.triad(box.x + round(0.8 * strip), middle, round(0.56 * strip), axes)
    end = sheet.scale_bar(
        box.right - sheet.units(18),
        middle + sheet.units(11),
        per_length,
        round(0.22 * box.width),
        stage.study.unit,
        "" if eye.is_parallel or box.width < sheet.units(480) else " in the middle",
    )
    left = box.x + round(1.6 * strip)
    title = sheet.shortened(_view_title(stage, view), end - sheet.units(12) - left, 16)
    sheet.text(left, middle, title, size=16, anchor="lm")


def _without_strip(sheet: Sheet, box: Box) -> Box:
    """Return the part of a box that is left above the strip for axes and scale bar."""
    strip = min(sheet.units(_STRIP), box.height // 3)
    return Box(box.x, box.y, box.width, box.height - strip)


def _cells(
    sheet: Sheet, box: Box, stage: Stage, views: list[View], columns: tuple[int, ...]
) -> list[Box]:
    """Return the grid, of one of the numbers of columns, that shows the views largest."""

    def scale(cells: list[Box]) -> float:
        return sum(
            stage.eye(view, frame.size, with_rig=view.is_parallel).pixels_per_length(frame.size)
            for view, frame in zip(views, (_without_strip(sheet, c) for c in cells), strict=True)
        )

    return max((grid(box, n, len(views) // n, sheet.units(12)) for n in columns), key=scale)


def _view_title(stage: Stage, view: View) -> str:
    """Return where a view is from, in words and along which axis."""
    label = axis_label(towards_eye(stage.study.up, view.azimuth_deg, view.elevation_deg))
    if label:
        return f"{view.name}, from {label}"
    return f"from azimuth {view.azimuth_deg:g}°, elevation {view.elevation_deg:g}°".replace(
        "-", "−"
    )

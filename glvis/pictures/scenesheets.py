"""Sheets of the scene: with its sensors large, from four sides, and the model alone.

Each function lays one model, painted already, on one sheet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from glvis.common.palette import UNSEEN_COLOR
from glvis.pictures.coloring import Coloring, Swatch, back_swatch, obstacle_swatch, share
from glvis.pictures.framing import Eye, View, axis_label, towards_eye
from glvis.pictures.gapviews import GapViews, gap_views
from glvis.pictures.places import Box, grid, halves
from glvis.pictures.sheet import Sheet
from glvis.pictures.stage import VEIL, Stage
from glvis.problem.camera import rigid_inverse

SIZE = (1600, 1000)
_HEAT_RELIEF = 0.55  # light and shade must not be taken for a value
_STRIP = 58  # units under a picture for axes, title and scale bar
# Where sensors stand so far off that the model is drawn smaller than this share of what alone it
# could be, it is drawn alone as well.
_SMALL = 0.5
_PARTS = (0.5, 0.4, 0.3, 0.6)  # of a sheet that the model alone may take


@dataclass(frozen=True)
class _Panel:
    """One view on a sheet: the model alone, or with the rig, or with frusta too."""

    view: View
    with_rig: bool = False
    with_frusta: bool = False
    veiled: bool = False


def perspective_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
    *,
    is_fixed: bool = False,
) -> Sheet:
    """Return the scene with its sensors and their frusta, and the model large.

    Parameters
    ----------
    stage, painted, size, direction
        As for the other sheets.
    is_fixed : bool
        Whether the model stands above and the scene below, wherever the sensors are: so that
        sheets of several layouts can be laid side by side.
    """
    view = _directed(stage, direction)
    with_rig = _Panel(view, with_rig=True, with_frusta=True)
    scales = [stage.eye(view, size, with_rig=rig).pixels_per_length(size) for rig in (True, False)]
    is_single = scales[0] >= _SMALL * scales[1] and not is_fixed
    panels = [with_rig] if is_single else [_Panel(view), with_rig]
    sheet, box = _prepared(stage, painted, size)
    if is_fixed:
        cells = halves(box, 0.5, sheet.units(12), stacked=True)
    else:
        cells = [box] if is_single else _split(sheet, box, stage, panels)
    for cell, panel in zip(cells, panels, strict=True):
        _draw_panel(sheet, cell, stage, panel, relief=1.0)
    return _with_legend(sheet, stage, painted, box)


def sides_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the scene with its sensors from top, front and side, and the model from behind."""
    views, far_side = stage.views(), stage.other_side(_directed(stage, direction))
    panels = [_Panel(views[k], with_rig=True) for k in ("top", "front", "side")]
    sheet, box = _prepared(stage, painted, size)
    _draw_panels(sheet, box, stage, [*panels, _Panel(far_side)], (1, 2, 4))
    return _with_legend(sheet, stage, painted, box)


def close_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the model alone, filling the picture, from the two sides that show most of it."""
    first = _directed(stage, direction)
    relief = _HEAT_RELIEF if painted.bar else 1.0
    panels = [_Panel(first), _Panel(stage.other_side(first))]
    sheet, box = _prepared(stage, painted, size)
    _draw_panels(sheet, box, stage, panels, (1, 2), relief=relief)
    return _with_legend(sheet, stage, painted, box)


def unseen_sheet(
    stage: Stage,
    painted: Coloring,
    size: tuple[int, int] = SIZE,
    direction: tuple[float, float] | None = None,
) -> Sheet:
    """Return the model alone, from where most of what nobody sees shows; gaps have numbers.

    Obstacles are faint: what they keep from being seen is what the picture is about.
    """
    found = gap_views(stage, _directed(stage, direction), is_fixed=direction is not None)
    panels = [_Panel(view, veiled=True) for view in found.views]
    painted = replace(painted, note=f"{painted.note}{_gap_words(stage, found)}")
    sheet, box = _prepared(stage, painted, size)
    eyes = _draw_panels(sheet, box, stage, panels, (1, 2) if len(panels) == 2 else (2,))
    for v, (frame, eye) in enumerate(eyes):
        places = np.array([at[v] for at in found.places]).reshape(-1, 3)
        names = [str(k) for k in range(1, len(places) + 1)]
        inks = np.tile(UNSEEN_COLOR, (len(places), 1))
        pixels = eye.project(places, frame.size)
        sheet.draw_labels(frame, pixels, names, inks, float(sheet.units(9)), is_pointing=True)
    return _with_legend(sheet, stage, painted, box, opacity=VEIL)


def _gap_words(stage: Stage, found: GapViews) -> str:
    """Return what the numbers of the gaps mean."""
    if not found.gaps:
        return ""
    model = stage.seen.model
    total = model.areas.sum()
    sizes = [f"{k}:\u00a0{share(gap.area / total)}" for k, gap in enumerate(found.gaps, start=1)]
    words = f" Largest gaps, of the area: {', '.join(sizes)}."
    if inside := found.hidden_gaps():
        words += f" None of these views shows {' and '.join(map(str, inside))}."
    return words


def neutral_rows(stage: Stage, opacity: float = 1.0) -> list[Swatch]:
    """Return the legend's rows for what was drawn and has no colour of its own.

    Parameters
    ----------
    stage : Stage
        Knows what was drawn.
    opacity : float
        Of obstacles.
    """
    backs = [back_swatch()] if stage.shows_backs else []
    return [*backs, *([obstacle_swatch(opacity)] if stage.study.obstacles else [])]


def subtitle(stage: Stage, facts: str = "") -> str:
    """Return what the sheet is about, in a line: the study, and what is seen in all."""
    seen, n = stage.seen, len(stage.study.sensors)
    whole = "the area" if seen.noun == "area" else f"{seen.model.n_faces:,} faces"
    who = "the sensor" if n == 1 else f"at least one of {n} sensors"
    facts = facts or f"{seen.share(seen.map.counts > 0)} of {whole} seen by {who}"
    return " · ".join([*([stage.study.title] if stage.study.title else []), facts])


def _prepared(stage: Stage, painted: Coloring, size: tuple[int, int]) -> tuple[Sheet, Box]:
    """Return a sheet with its heading, and the room that its legend leaves for pictures."""
    sheet = Sheet(size)
    top = sheet.heading(
        f"{stage.seen.model.name} · {painted.title}", subtitle(stage, painted.facts)
    )
    stage.shows_backs = False
    margin, gap = sheet.units(28), sheet.units(26)
    right = size[0] - 2 * margin - sheet.legend_width([painted]) - gap
    return sheet, Box(margin, top, right, size[1] - top - margin)


def _with_legend(
    sheet: Sheet, stage: Stage, painted: Coloring, box: Box, *, opacity: float = 1.0
) -> Sheet:
    """Return the sheet with its legend beside the pictures, which say what must be in it."""
    width, margin = sheet.legend_width([painted]), sheet.units(28)
    column = Box(sheet.size[0] - margin - width, box.y, width, box.height)
    sheet.legend(column, painted, neutral_rows(stage, opacity))
    return sheet


def _directed(stage: Stage, direction: tuple[float, float] | None) -> View:
    """Return the view in perspective, from another direction if one is wanted."""
    view = stage.views()["perspective"]
    return view if direction is None else View(view.name, *direction, is_parallel=False)


def _draw_panels(
    sheet: Sheet,
    box: Box,
    stage: Stage,
    panels: list[_Panel],
    columns: tuple[int, ...],
    *,
    relief: float = 1.0,
) -> list[tuple[Box, Eye]]:
    """Draw panels in the best of the numbers of columns; return their pictures' boxes and eyes."""
    cells = _cells(sheet, box, stage, panels, columns)
    return [
        _draw_panel(sheet, cell, stage, panel, relief)
        for cell, panel in zip(cells, panels, strict=True)
    ]


def _draw_panel(
    sheet: Sheet, box: Box, stage: Stage, panel: _Panel, relief: float
) -> tuple[Box, Eye]:
    """Draw the scene into a framed box, and under it axes, direction of view and scale bar."""
    view, with_rig = panel.view, panel.with_rig
    frame = _without_strip(sheet, box)
    strip = box.height - frame.height
    eye = stage.eye(view, frame.size, with_rig=with_rig)
    picture = stage.picture(
        eye,
        frame.size,
        with_rig=with_rig,
        with_frusta=panel.with_frusta,
        pixel=max(0.8, sheet.unit),
        relief=relief,
        cut_away=stage.is_room,
        veiled=panel.veiled,
    )
    sheet.paste(picture, frame.x, frame.y)
    sheet.frame(frame)
    sheet.frame(box)
    per_length = eye.pixels_per_length(frame.size)
    if with_rig:
        centres = stage.poses[:, :3, 3]
        places = eye.project(centres, frame.size)
        clear = 1.05 * stage.body_size * per_length
        hidden = stage.is_hidden(centres, eye, frame.size, cut_away=stage.is_room)
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
        "" if eye.is_parallel or box.width < sheet.units(480) else " at mid-depth",
    )
    left = box.x + round(1.6 * strip)
    room, titles = end - sheet.units(12) - left, _view_titles(stage, view)
    title = next((t for t in titles if sheet.text_width(t, 16) <= room), titles[-1])
    sheet.text(left, middle, sheet.shortened(title, room, 16), size=16, anchor="lm")
    return frame, eye


def _without_strip(sheet: Sheet, box: Box) -> Box:
    """Return the part of a box that is left above the strip for axes and scale bar."""
    strip = min(sheet.units(_STRIP), box.height // 3)
    return Box(box.x, box.y, box.width, box.height - strip)


def _cells(
    sheet: Sheet, box: Box, stage: Stage, panels: list[_Panel], columns: tuple[int, ...]
) -> list[Box]:
    """Return the grid, of one of the numbers of columns, that shows the panels largest."""

    def scale(cells: list[Box]) -> float:
        return sum(
            stage.eye(p.view, frame.size, with_rig=p.with_rig).pixels_per_length(frame.size)
            for p, frame in zip(panels, (_without_strip(sheet, c) for c in cells), strict=True)
        )

    return max((grid(box, n, len(panels) // n, sheet.units(12)) for n in columns), key=scale)


def _split(sheet: Sheet, box: Box, stage: Stage, panels: list[_Panel]) -> list[Box]:
    """Return two cells for two panels that show both as large as can be, beside what each could."""

    def scales(cells: list[Box]) -> list[float]:
        frames = [_without_strip(sheet, cell) for cell in cells]
        eyes = [
            stage.eye(panel.view, frame.size, with_rig=panel.with_rig)
            for panel, frame in zip(panels, frames, strict=True)
        ]
        return [eye.pixels_per_length(f.size) for eye, f in zip(eyes, frames, strict=True)]

    alone = scales([box, box])

    def worth(cells: list[Box]) -> float:
        return math.prod(a / b for a, b in zip(scales(cells), alone, strict=True))

    gap = sheet.units(12)
    tried = [halves(box, part, gap, stacked=way) for way in (False, True) for part in _PARTS]
    return max(tried, key=worth)


def _view_titles(stage: Stage, view: View) -> tuple[str, ...]:
    """Return where a view is from, in words and along which axis; the longest first."""
    label = axis_label(towards_eye(stage.study.up, view.azimuth_deg, view.elevation_deg))
    if label:
        named = (f"{view.name}, from {label}", view.name)
        return named if view.is_parallel else (f"from {label}",)
    azimuth, elevation = (
        f"{angle:g}°".replace("-", "−") for angle in (view.azimuth_deg, view.elevation_deg)
    )
    return f"from azimuth {azimuth}, elevation {elevation}", f"from {azimuth}, {elevation}"

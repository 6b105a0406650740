"""Sheets of what single sensors see: the view through one, its depth, and all of them at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from glvis.common.palette import rgb
from glvis.pictures.coloring import Bar, Coloring, Swatch, ramp_colors, seen_by_one
from glvis.pictures.places import Box, grid, length_words, number
from glvis.pictures.scenesheets import SIZE, neutral_rows, subtitle
from glvis.pictures.sheet import Sheet
from glvis.pictures.stage import Stage

Colors = NDArray[np.uint8]

_NEARER, _FARTHER, _NOTHING = rgb("#6E7480"), rgb("#C3C8D0"), rgb("#FFFFFF")


def sensor_sheet(stage: Stage, s: int, size: tuple[int, int] = SIZE) -> Sheet:
    """Return the view through sensor ``s`` at its own aspect, coloured by what it sees."""
    painted = seen_by_one(stage.seen, s, stage.colors)
    sheet, box, column = _sensor_page(stage, s, painted, size)
    stage.paint(painted.colors)
    stage.shows_backs = False
    view = stage.picture(stage.sensor_eye(s), box.size, pixel=max(0.8, sheet.unit))
    sheet.paste(view, box.x, box.y)
    sheet.frame(box, tuple(stage.colors[s].tolist()), max(2, sheet.units(3)))
    sheet.legend(column, painted, neutral_rows(stage))
    return sheet


def depth_sheet(stage: Stage, s: int, size: tuple[int, int] = SIZE) -> Sheet:
    """Return the depth that sensor ``s`` measures, along its optical axis."""
    sensor, name, unit = stage.study.sensors[s], stage.seen.map.sensor_names[s], stage.study.unit
    low, high = sensor.min_distance, sensor.max_distance
    painted = Coloring(
        f"{name}: the depth it measures",
        np.zeros((0, 4), dtype=np.uint8),
        [
            *([Swatch(_NEARER, f"nearer than {length_words(low, unit)}")] if low > 0 else []),
            Swatch(_FARTHER, f"beyond {length_words(high, unit)}"),
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
    """Return the views through all sensors on one sheet, no higher than they need."""
    seen, names, sensors = stage.seen, stage.seen.map.sensor_names, stage.study.sensors
    blank = Sheet(size)
    margin, gap, caption = blank.units(28), blank.units(18), blank.units(32)
    top = blank.units(104)
    room = Box(margin, top, size[0] - 2 * margin, size[1] - top - margin)
    aspects = [float(t[0] / t[1]) for t in (s.lens.tan_half for s in sensors)]

    def cell_size(columns: int) -> tuple[int, int]:
        cell = grid(room, columns, math.ceil(len(names) / columns), gap)[0]
        width = max(1, min(cell.width, int((cell.height - caption) * max(aspects))))
        return width, columns

    width, columns = max(map(cell_size, range(1, len(names) + 1)))
    rows = math.ceil(len(names) / columns)
    height = caption + max(round(width / aspect) for aspect in aspects)
    height = min(height, (room.height - gap * (rows - 1)) // rows)
    sheet = Sheet((size[0], top + rows * (height + gap) - gap + margin), blank.unit)
    greys = " · light grey is not counted" + (
        ", dark grey is an obstacle" if stage.study.obstacles else ""
    )
    sheet.heading(f"{seen.model.name} · What each sensor sees", subtitle(stage) + greys)
    box = Box(margin, top, columns * (width + gap) - gap, rows * (height + gap) - gap)
    box = Box((size[0] - box.width) // 2, top, box.width, box.height)
    for s, cell in enumerate(grid(box, columns, rows, gap)[: len(names)]):
        w = max(1, min(cell.width, int((cell.height - caption) * aspects[s])))
        picture = Box(
            cell.x + (cell.width - w) // 2, cell.y + caption, w, max(1, round(w / aspects[s]))
        )
        stage.paint(seen_by_one(seen, s, stage.colors).colors)
        view = stage.picture(stage.sensor_eye(s), picture.size, pixel=max(0.8, sheet.unit))
        sheet.paste(view, picture.x, picture.y)
        sheet.frame(picture, tuple(stage.colors[s].tolist()), max(2, sheet.units(2.5)))
        line = picture.y - sheet.units(8)
        value = seen.share(seen.map.visible[s])
        left = w - sheet.text_width(value, 17) - sheet.units(8)
        label = sheet.shortened(names[s], left, 19, bold=True)
        sheet.text(picture.x, line, label, size=19, bold=True, anchor="ls")
        sheet.text(picture.right, line, value, size=17, anchor="rs")
    return sheet


def _sensor_page(
    stage: Stage, s: int, painted: Coloring, size: tuple[int, int]
) -> tuple[Sheet, Box, Box]:
    """Return a sheet of a sensor's own aspect, with heading, its picture's box and the legend's."""
    sensor = stage.study.sensors[s]
    blank = Sheet(size)
    margin, gap, legend = blank.units(28), blank.units(26), blank.legend_width([painted])
    top, bottom = blank.units(104), blank.units(40)
    tan = sensor.lens.tan_half
    width = min(
        size[0] - 2 * margin - gap - legend, int((size[1] - top - bottom) * tan[0] / tan[1])
    )
    height = max(1, round(width * float(tan[1] / tan[0])))
    needed = max(height, blank.units(460))
    sheet = Sheet((2 * margin + gap + legend + width, top + needed + bottom), blank.unit)
    hfov, vfov = (math.degrees(v) for v in sensor.lens.opening)
    pixels = f"{sensor.resolution[0]} x {sensor.resolution[1]} pixels".replace(" x ", " × ")
    sheet.heading(
        f"{painted.title} of {stage.seen.model.name}",
        f"{sensor.name} · {pixels} · {hfov:.4g}° × {vfov:.4g}° · "
        f"{number(sensor.min_distance)} to {length_words(sensor.max_distance, stage.study.unit)}",
    )
    box = Box(margin, top, width, height)
    return sheet, box, Box(box.right + gap, top, legend, needed)


def _depth_picture(depth: NDArray[np.float32], samples: int, low: float, high: float) -> Colors:
    """Return depths as colours (H, W, 3), averaged over the samples of each pixel."""
    levels = 1021  # smooth also where the depth hardly changes
    ramp = ramp_colors(np.linspace(low, high, levels), low, high)
    table = np.vstack([ramp, [_NEARER, _FARTHER, _NOTHING]]).astype(np.uint16)
    scaled = (np.clip(depth, low, high) - low) * np.float32((levels - 1) / (high - low))
    index = (scaled + np.float32(0.5)).astype(np.uint16)
    index[depth < low] = levels
    index[depth > high] = levels + 1
    index[np.isinf(depth)] = levels + 2
    total = np.zeros((depth.shape[0] // samples, depth.shape[1] // samples, 3), dtype=np.uint16)
    for sample in np.ndindex(samples, samples):
        total += table[index[sample[0] :: samples, sample[1] :: samples]]
    return (total // samples**2).astype(np.uint8)

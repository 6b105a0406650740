"""Sheets of what single sensors see: the view through one, its depth, and all of them at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glvis.common.palette import NO_RAY, rgb
from glvis.pictures.bars import Bar, ramp_colors
from glvis.pictures.coloring import Coloring, Swatch, seen_by_one
from glvis.pictures.places import Box, grid, length_words, number
from glvis.pictures.scenesheets import SIZE, neutral_rows, subtitle
from glvis.pictures.sheet import Sheet
from glvis.pictures.stage import Stage
from glvis.problem.field import image_aspect, lens_words, partner_words
from glvis.problem.sensor import Sensor

Colors = NDArray[np.uint8]

_BAND = 4.0  # width over height beyond which a picture takes all the width of a sheet
_BAND_LEGEND = 420  # units, width of the legend under it
_NEARER, _FARTHER, _NOTHING = rgb("#6E7480"), rgb("#C3C8D0"), rgb("#FFFFFF")


def sensor_sheet(stage: Stage, s: int, size: tuple[int, int] = SIZE) -> Sheet:
    """Return the view through sensor ``s`` at its own aspect, coloured by what it sees."""
    painted = seen_by_one(stage.seen, s, stage.colors)
    sheet, box, columns = _sensor_page(stage, s, painted, size)
    stage.paint(painted.colors)
    stage.shows_backs = False
    view = stage.sensor_picture(s, box.size, pixel=max(0.8, sheet.unit))
    sheet.paste(view, box.x, box.y)
    sheet.frame(box, tuple(stage.colors[s].tolist()), max(2, sheet.units(3)))
    _draw_legend(
        sheet, columns, painted, [*neutral_rows(stage), *_rayless([stage.study.sensors[s]])]
    )
    return sheet


def depth_sheet(stage: Stage, s: int, size: tuple[int, int] = SIZE) -> Sheet:
    """Return what sensor ``s`` measures: depth along its optical axis, or range."""
    sensor, name, unit = stage.study.sensors[s], stage.seen.map.sensor_names[s], stage.study.unit
    low, high = sensor.min_distance, sensor.max_distance
    by_range = sensor.distance == "range"
    painted = Coloring(
        f"{name}: the {sensor.distance} it measures",
        np.zeros((0, 4), dtype=np.uint8),
        [
            *([Swatch(_NEARER, f"nearer than {length_words(low, unit)}")] if low > 0 else []),
            Swatch(_FARTHER, f"beyond {length_words(high, unit)}"),
            Swatch(_NOTHING, "nothing there"),
            *_rayless([sensor]),
        ],
        Bar(low, high, f"distance {'from its centre' if by_range else 'along the axis'}", unit),
        "As the first viewpoint has it; where the second does not see, none is measured."
        if sensor.partner
        else "",
    )
    sheet, box, columns = _sensor_page(stage, s, painted, size)
    distances, samples = stage.sensor_distances(s, box.size)
    sheet.paste(_distance_picture(distances, samples, low, high), box.x, box.y)
    sheet.frame(box, tuple(stage.colors[s].tolist()), max(2, sheet.units(3)))
    _draw_legend(sheet, columns, painted)
    return sheet


def contact_sheet(stage: Stage, size: tuple[int, int] = SIZE) -> Sheet:
    """Return the views through all sensors on one sheet, no higher than they need."""
    seen, names, sensors = stage.seen, stage.seen.map.sensor_names, stage.study.sensors
    blank = Sheet(size)
    margin, gap, caption = blank.units(28), blank.units(18), blank.units(32)
    top = blank.units(104)
    room = Box(margin, top, size[0] - 2 * margin, size[1] - top - margin)
    aspects = [image_aspect(sensor.lens) for sensor in sensors]

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
    greys += "; where it is flat and dark, the lens has no ray" if _rayless(sensors) else ""
    sheet.heading(f"{seen.model.name} · What each sensor sees", subtitle(stage) + greys)
    box = Box(margin, top, columns * (width + gap) - gap, rows * (height + gap) - gap)
    box = Box((size[0] - box.width) // 2, top, box.width, box.height)
    for s, cell in enumerate(grid(box, columns, rows, gap)[: len(names)]):
        w = max(1, min(cell.width, int((cell.height - caption) * aspects[s])))
        picture = Box(
            cell.x + (cell.width - w) // 2, cell.y + caption, w, max(1, round(w / aspects[s]))
        )
        stage.paint(seen_by_one(seen, s, stage.colors).colors)
        view = stage.sensor_picture(s, picture.size, pixel=max(0.8, sheet.unit))
        sheet.paste(view, picture.x, picture.y)
        sheet.frame(picture, tuple(stage.colors[s].tolist()), max(2, sheet.units(2.5)))
        line = picture.y - sheet.units(8)
        value = seen.share(seen.map.visible[s])
        left = w - sheet.text_width(value, 17) - sheet.units(8)
        label = sheet.shortened(names[s], left, 19, bold=True)
        sheet.text(picture.x, line, label, size=19, bold=True, anchor="ls")
        sheet.text(picture.right, line, value, size=17, anchor="rs")
    return sheet


def sensor_words(sensor: Sensor, unit: str) -> str:
    """Return a sensor in a line: pixels, opening, lens and working range."""
    lens = sensor.lens
    hfov, vfov = (math.degrees(v) for v in lens.opening)
    pixels = f"{sensor.resolution[0]} × {sensor.resolution[1]} pixels"
    kind = f" {bent}" if (bent := lens_words(lens)) else ""
    reach = f"{number(sensor.min_distance)} to {length_words(sensor.max_distance, unit)}"
    reach += " from its centre" if sensor.distance == "range" else ""
    words = [sensor.name, pixels, f"{hfov:.4g}° × {vfov:.4g}°{kind}", reach]
    if sensor.partner:
        baseline = length_words(float(f"{sensor.partner.baseline:.4g}"), unit)
        words.append(f"{partner_words(sensor)} {baseline} beside")
    return " · ".join(words)


def _rayless(sensors: Sequence[Sensor]) -> list[Swatch]:
    """Return the legend's row for pixels without a ray, where any sensor has such."""
    has_any = any(sensor.lens.has_blind_corners for sensor in sensors)
    return [Swatch(NO_RAY, "no ray: the lens ends")] if has_any else []


def _sensor_page(
    stage: Stage, s: int, painted: Coloring, size: tuple[int, int]
) -> tuple[Sheet, Box, list[Box]]:
    """Return a sheet of a sensor's own aspect, with heading, and boxes of picture and legend."""
    sensor = stage.study.sensors[s]
    aspect = image_aspect(sensor.lens)
    blank = Sheet(size)
    margin, gap, legend = blank.units(28), blank.units(26), blank.legend_width([painted])
    top, bottom = blank.units(104), blank.units(40)
    is_band = aspect > _BAND  # all the width for the picture, the legend under it
    beside = 0 if is_band else gap + legend
    width = min(size[0] - 2 * margin - beside, int((size[1] - top - bottom) * aspect))
    height = max(1, round(width / aspect))
    under = blank.units(340 if painted.bar else 260)  # a colour bar, or a few rows and a note
    needed = under if is_band else max(height, blank.units(460))
    total = height + gap + needed if is_band else needed
    sheet = Sheet((2 * margin + beside + width, top + total + bottom), blank.unit)
    sheet.heading(
        f"{painted.title} of {stage.seen.model.name}", sensor_words(sensor, stage.study.unit)
    )
    box = Box(margin, top, width, height)
    if not is_band:
        return sheet, box, [Box(box.right + gap, top, legend, needed)]
    column = Box(margin, box.bottom + gap, blank.units(_BAND_LEGEND), needed)
    return sheet, box, [column, replace(column, x=column.right + gap)]


def _draw_legend(
    sheet: Sheet, columns: list[Box], painted: Coloring, extra: Sequence[Swatch] = ()
) -> None:
    """Draw a legend in one column, or its bar and its rows in a column each."""
    if painted.bar and len(columns) > 1:
        sheet.color_bar(replace(columns[0], height=sheet.units(300)), painted.bar)
        sheet.legend(columns[1], replace(painted, bar=None), extra)
    else:
        sheet.legend(columns[0], painted, extra)


def _distance_picture(
    distance: NDArray[np.float32], samples: int, low: float, high: float
) -> Colors:
    """Return distances as colours (H, W, 3), averaged over the samples of each pixel."""
    levels = 1021  # smooth also where the depth hardly changes
    ramp = ramp_colors(np.linspace(low, high, levels), low, high)
    table = np.vstack([ramp, [_NEARER, _FARTHER, _NOTHING, NO_RAY]]).astype(np.uint16)
    has_ray = ~np.isnan(distance)
    distance = np.where(has_ray, distance, np.float32(low))
    scaled = (np.clip(distance, low, high) - low) * np.float32((levels - 1) / (high - low))
    index = (scaled + np.float32(0.5)).astype(np.uint16)
    index[distance < low] = levels
    index[distance > high] = levels + 1
    index[np.isinf(distance)] = levels + 2
    index[~has_ray] = levels + 3
    shape = distance.shape[0] // samples, distance.shape[1] // samples, 3
    total = np.zeros(shape, dtype=np.uint16)
    for sample in np.ndindex(samples, samples):
        total += table[index[sample[0] :: samples, sample[1] :: samples]]
    return (total // samples**2).astype(np.uint8)

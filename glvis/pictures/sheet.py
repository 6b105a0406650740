"""A sheet of paper: pictures, titles, legends, colour bars, scale bars, axes and labels on it.

The only module that talks to Pillow. Places are pixels from the top left corner; sizes follow
the sheet's, so that a large sheet is the same sheet with more pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from glvis.pictures.bars import Bar
from glvis.pictures.coloring import Coloring, Swatch
from glvis.pictures.places import (
    Box,
    label_places,
    length_words,
    log_ticks,
    number,
    readable,
    round_length,
    ticks,
)

Floats = NDArray[np.float64]
Colors = NDArray[np.uint8]

INK, SOFT_INK, FRAME = (33, 37, 43), (98, 105, 116), (176, 182, 190)
_AXIS_COLORS = ((196, 42, 42), (42, 128, 42), (38, 84, 190))  # X, Y, Z as everywhere
_FINE = 4  # times larger that slanted shapes are drawn before they are averaged


class Sheet:
    """A white sheet to draw on.

    Parameters
    ----------
    size : tuple of int
        Pixels (width, height).
    unit : float, optional
        Pixels that one unit of the layout is; text is 18 units high. By the size if not given.
    """

    def __init__(self, size: tuple[int, int], unit: float | None = None) -> None:
        self.size = size
        self.unit = unit or max(0.5, min(size[0] / 1600, size[1] / 1000))
        self._image = Image.new("RGB", size, "white")
        self._draw = ImageDraw.Draw(self._image)

    def units(self, n: float) -> int:
        """Return ``n`` units of the layout in pixels."""
        return round(n * self.unit)

    def pixels(self) -> Colors:
        """Return the sheet as (H, W, 3) uint8."""
        return np.array(self._image)

    def save(self, path: Path) -> None:
        """Write the sheet as PNG."""
        self._image.save(path, format="PNG", compress_level=4)

    def paste(self, picture: Colors, x: int, y: int) -> None:
        """Lay a picture (H, W, 3) uint8 on the sheet."""
        self._image.paste(Image.fromarray(np.ascontiguousarray(picture)), (x, y))

    def frame(self, box: Box, color: tuple[int, int, int] = FRAME, width: int = 1) -> None:
        """Draw a thin frame just outside a box."""
        for k in range(1, width + 1):
            self._draw.rectangle(
                (box.x - k, box.y - k, box.right + k - 1, box.bottom + k - 1), outline=color
            )

    def font(self, size: float, bold: bool = False) -> Any:
        """Return the font of so many units."""
        return _font(max(8, round(size * self.unit)), bold)

    def text_width(self, text: str, size: float = 18, bold: bool = False) -> int:
        """Return the pixels that a line of text takes."""
        return math.ceil(self.font(size, bold).getlength(_one_line(text)))

    def text(
        self,
        x: int,
        y: int,
        text: str,
        *,
        size: float = 18,
        bold: bool = False,
        color: tuple[int, ...] = INK,
        anchor: str = "la",
        halo: bool = False,
    ) -> None:
        """Write a line of text; ``anchor`` is Pillow's."""
        self._draw.text(
            (x, y),
            _one_line(text),
            fill=color,
            font=self.font(size, bold),
            anchor=anchor,
            stroke_width=max(1, self.units(2.5)) if halo else 0,
            stroke_fill="white",
        )

    def paragraph(
        self, x: int, y: int, width: int, text: str, *, size: float = 15, measure: bool = False
    ) -> int:
        """Write text broken into lines of a width; return the row below."""
        leading = round(self.font(size).size * 1.32)
        for line in self.wrapped(text, width, size):
            if not measure:
                self.text(x, y, line, size=size, color=SOFT_INK)
            y += leading
        return y

    def wrapped(self, text: str, width: int, size: float) -> list[str]:
        """Return text as lines no wider than ``width`` pixels, where words allow."""
        lines: list[str] = []
        for word in text.split(" "):
            longer = f"{lines[-1]} {word}" if lines else word
            if lines and self.text_width(longer, size) <= width:
                lines[-1] = longer
            else:
                lines.append(word)
        return lines

    def shortened(self, text: str, width: int, size: float, bold: bool = False) -> str:
        """Return text cut with an ellipsis where it is wider than ``width`` pixels."""
        if self.text_width(text, size, bold) <= width:
            return text
        while text and self.text_width(text + "…", size, bold) > width:
            text = text[:-1]
        return text.rstrip() + "…"

    def heading(self, title: str, subtitle: str) -> int:
        """Write the sheet's title and a line under it; return the first free row."""
        margin = self.units(28)
        width = self.size[0] - 2 * margin
        self.text(
            margin, self.units(22), self.shortened(title, width, 27, True), size=27, bold=True
        )
        line = self.shortened(subtitle, width, 17)
        self.text(margin, self.units(62), line, size=17, color=SOFT_INK)
        return self.units(96)

    def legend_width(self, colorings: Iterable[Coloring]) -> int:
        """Return the pixels that the legends' columns need."""
        widths = [self.units(190)]
        for coloring in colorings:
            for row in coloring.swatches:
                label = self.text_width(row.label) + self.units(34)
                value = self.text_width(row.value) + self.units(18) if row.value else 0
                widths.append(label + value)
        return min(max(widths), self.size[0] // 3)

    def legend(self, box: Box, coloring: Coloring, extra: Sequence[Swatch] = ()) -> None:
        """Draw swatches, colour bar and note in a column."""
        y = box.y
        rows = [*coloring.swatches, *extra]
        if coloring.bar is not None:
            y = self.color_bar(Box(box.x, y, box.width, self.units(300)), coloring.bar)
            y += self.units(22)
        elif any(row.value for row in rows):
            self.text(box.right, y, coloring.heading, size=15, color=SOFT_INK, anchor="ra")
            y += self.units(25)
        below = self.paragraph(0, self.units(14), box.width, coloring.note, measure=True)
        step = min(self.units(31), max(9, (box.bottom - y - below) // max(1, len(rows))))
        chip, text_size = round(0.71 * step), min(18.0, 0.58 * step / self.unit)
        for row in rows:
            self.chip(box.x, y, chip, row)
            middle = y + chip // 2
            room = box.width - self.units(34)
            if row.value:
                self.text(box.right, middle, row.value, size=text_size, anchor="rm")
                room -= self.text_width(row.value, text_size) + self.units(10)
            label = self.shortened(row.label, room, text_size)
            self.text(box.x + self.units(34), middle, label, size=text_size, anchor="lm")
            y += step
        if coloring.note:
            self.paragraph(box.x, y + self.units(14), box.width, coloring.note)

    def chip(self, x: int, y: int, size: int, swatch: Swatch) -> None:
        """Draw a swatch's square."""
        square = np.broadcast_to(swatch.color, (size, size, 3)).copy()
        if swatch.is_striped:
            period = max(3, round(size / 3.2))
            i, j = np.indices((size, size))
            square[(i + j) % period >= 0.62 * period] = np.round(swatch.color * 0.63)
        self.paste(square, x, y)
        self.frame(Box(x, y, size, size), FRAME)

    def color_bar(self, box: Box, bar: Bar) -> int:
        """Draw a bar, its light end up, with quantity, unit and ticks; return the row below."""
        unit = f" ({bar.unit})" if bar.unit else ""
        y = self.paragraph_ink(box.x, box.y, box.width, f"{bar.label}{unit}")
        width, top = self.units(26), y + self.units(12)
        height = box.bottom - top
        spaced = np.geomspace if bar.is_log else np.linspace
        values = spaced(bar.low, bar.high, height)[:: -1 if bar.is_falling else 1, None]
        self.paste(bar.colors(np.repeat(values, width, axis=1)), box.x, top)
        self.frame(Box(box.x, top, width, height), FRAME)
        marks = (log_ticks if bar.is_log else ticks)(bar.low, bar.high)
        for value in marks:
            share = float(bar.share(value))
            at = top + round((1 - share if bar.is_falling else share) * (height - 1))
            self._draw.line(
                (box.x + width, at, box.x + width + self.units(6), at),
                fill=INK,
                width=max(1, self.units(1.5)),
            )
            left = box.x + width + self.units(12)
            ends = zip(bar.goes_on, ("≤", "≥"), (marks[0], marks[-1]), strict=True)
            sign = "".join(
                f"{sign}\u202f" for goes_on, sign, end in ends if goes_on and value == end
            )
            self.text(left, at, sign + number(value), size=16, anchor="lm")
        return box.bottom

    def paragraph_ink(self, x: int, y: int, width: int, text: str) -> int:
        """Write a label that may take several lines; return the row below."""
        for line in self.wrapped(text, width, 18):
            self.text(x, y, line)
            y += self.units(25)
        return y

    def scale_bar(
        self, right: int, y: int, pixels_per_length: float, room: int, unit: str, remark: str = ""
    ) -> int:
        """Draw a bar of a round length that ends at ``right``; return where it and label begin."""
        length = round_length(room / pixels_per_length)
        width = max(1, round(length * pixels_per_length))
        thick, tick = max(1, self.units(2.5)), self.units(5)
        left = right - width
        self._draw.rectangle((left, y, right, y + thick - 1), fill=INK)
        for x in (left, right - thick + 1):
            self._draw.rectangle((x, y - tick, x + thick - 1, y + thick - 1 + tick), fill=INK)
        text = length_words(length, unit) + remark
        self.text(right, y - self.units(8), text, size=16, anchor="rd")
        return min(left, right - self.text_width(text, 16))

    def triad(self, x: int, y: int, size: int, axes: Floats) -> None:
        """Draw the world's axes; a point is in the middle of them.

        Parameters
        ----------
        x, y : int
            Pixels of that point.
        size : int
            Pixels of an axis that lies in the picture.
        axes : (3, 3) float
            World axes as columns, in the eye's frame: x right, y up, z towards the eye.
        """
        tips = np.vstack([axes[:2].T * [1, -1] * size * 0.8, [0, 0]])
        middle_of_all = (tips.min(axis=0) + tips.max(axis=0)) / 2
        x, y = x - round(middle_of_all[0]), y - round(middle_of_all[1])
        reach = round(size * 1.15) + 2
        edge = 2 * reach * _FINE
        layer = Image.new("RGBA", (edge, edge), (255, 255, 255, 0))
        draw = ImageDraw.Draw(layer)
        order = np.argsort(axes[2])  # the farthest end first
        labels: list[tuple[float, float, str, tuple[int, int, int]]] = []
        for k in order:
            tip = axes[:2, k] * [1, -1] * size * 0.8
            length = float(np.linalg.norm(tip))
            color = _AXIS_COLORS[k]
            middle = reach * _FINE
            if length < 0.12 * size:  # towards or away from the eye
                r = size * 0.11 * _FINE
                ring = (middle - r, middle - r, middle + r, middle + r)
                width = max(_FINE, round(size * 0.035 * _FINE))
                draw.ellipse(ring, outline=(*color, 255), fill=(255, 255, 255, 255), width=width)
                if axes[2, k] > 0:
                    d = r * 0.38
                    dot = (middle - d, middle - d, middle + d, middle + d)
                    draw.ellipse(dot, fill=(*color, 255))
                else:
                    s = r * 0.62
                    for sign in (-1, 1):
                        cross = (middle - s, middle - sign * s, middle + s, middle + sign * s)
                        draw.line(cross, fill=(*color, 255), width=width)
                labels.append((-0.26 * size, 0.26 * size, "XYZ"[k], color))
                continue
            along = tip / length
            across = np.array([-along[1], along[0]])
            head, half = 0.22 * size, 0.085 * size
            thick = max(1.0, 0.032 * size)
            shaft = tip - along * head * 0.9
            corners = np.array([across, -across]) * thick
            quad = [corners[0], shaft + corners[0], shaft + corners[1], corners[1]]
            arrow = [tip, tip - along * head + across * half, tip - along * head - across * half]
            for shape in (quad, arrow):
                points = [tuple((p + reach) * _FINE) for p in shape]
                draw.polygon(points, fill=(*color, 255))
            out = tip + along * 0.17 * size
            labels.append((out[0], out[1], "XYZ"[k], color))
        small = layer.reduce(_FINE)
        self._image.paste(small, (x - reach, y - reach), small)
        points_per_unit = size / self.unit
        for dx, dy, letter, color in labels:
            self.text(
                round(x + dx),
                round(y + dy),
                letter,
                size=max(12, 0.26 * points_per_unit),
                bold=True,
                color=color,
                anchor="mm",
                halo=True,
            )

    def draw_labels(
        self,
        box: Box,
        places: Floats,
        names: Sequence[str],
        colors: Colors,
        clear: float,
        *,
        is_pointing: bool = False,
    ) -> None:
        """Write names beside places of a box, clear of each other and of the places.

        Parameters
        ----------
        box : Box
            The picture; nothing is written outside.
        places : (N, 2) float
            Pixels from the box's corner; NaN or outside is left out.
        names, colors : sequence of str, (N, 3) uint8
            Text and its colour, darkened where it would not be read on white.
        clear : float
            Pixels to keep free around each place.
        is_pointing : bool
            Whether to mark each place by a dot, and a line to its name.
        """
        height = self.font(19, True).size * 1.1
        sizes = [(self.text_width(name, 19, True) + self.units(6), height) for name in names]
        for k, centre in label_places(places, sizes, clear, box.size).items():
            if is_pointing:
                corner = np.array([box.x, box.y])
                self._point(corner + places[k], corner + centre)
            self.text(
                round(box.x + centre[0]),
                round(box.y + centre[1]),
                names[k],
                size=19,
                bold=True,
                color=readable(colors[k]),
                anchor="mm",
                halo=True,
            )

    def _point(self, at: Floats, label: Floats) -> None:
        """Draw a dot at a place and a line from there to its label."""
        r = max(1.5, 2.5 * self.unit)
        for width, color in ((3.5, "white"), (1.5, INK)):
            line = (*at.tolist(), *(at + 0.75 * (label - at)).tolist())
            self._draw.line(line, fill=color, width=max(1, self.units(width)))
        self._draw.ellipse((*(at - r).tolist(), *(at + r).tolist()), fill=INK, outline="white")


def _one_line(text: str) -> str:
    """Return text without line breaks and the like, which a line of text cannot have."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


@cache
def _font(pixels: int, bold: bool) -> Any:
    """Return DejaVu Sans, which comes with matplotlib and has every script of names we know."""
    found = find_spec("matplotlib")
    if found is not None and found.origin is not None:
        name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
        path = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / name
        if path.is_file():
            return ImageFont.truetype(str(path), pixels)
    return ImageFont.load_default(pixels)

"""Contact sheets of many models: each with what nobody sees on it, the least seen first."""

from __future__ import annotations

import math
from collections.abc import Sequence

from glvis.pictures.coloring import coloring
from glvis.pictures.places import Box, grid
from glvis.pictures.scenesheets import SIZE
from glvis.pictures.sheet import Sheet
from glvis.pictures.stage import Stage
from glvis.visibility.visibility_map import VisibilityMap

_COLUMNS, _ROWS = 6, 5
MODELS_A_SHEET = _COLUMNS * _ROWS


def models_sheet(
    stage: Stage,
    maps: Sequence[VisibilityMap],
    some: Sequence[int],
    page: tuple[int, int],
    size: tuple[int, int] = SIZE,
) -> Sheet:
    """Return a sheet of several models, no higher than they need.

    Parameters
    ----------
    stage : Stage
        Shows the last of the models afterwards.
    maps : sequence of VisibilityMap
        One a model of the study.
    some : sequence of int
        Which models, ``MODELS_A_SHEET`` at most.
    page : (int, int)
        Which of how many such sheets this is.
    """
    blank = Sheet(size)
    margin, gap, caption = blank.units(28), blank.units(14), blank.units(30)
    top = blank.units(104)
    width = (size[0] - 2 * margin - gap * (_COLUMNS - 1)) // _COLUMNS
    room = (size[1] - top - margin - gap * (_ROWS - 1)) // _ROWS
    height, rows = min(room, width + caption), math.ceil(len(some) / _COLUMNS)
    sheet = Sheet((size[0], top + rows * (height + gap) - gap + margin), blank.unit)
    title, n = stage.study.title, len(stage.study.models)
    sheet.heading(
        f"All {n} models · What no sensor sees, the least seen first ({page[0]} of {page[1]})",
        f"{title} · striped: no sensor sees it; beside each name the share that is seen".lstrip(
            " ·"
        ),
    )
    box = Box(margin, top, size[0] - 2 * margin, rows * (height + gap) - gap)
    for m, cell in zip(some, grid(box, _COLUMNS, rows, gap), strict=False):
        seen = stage.show(m, maps[m])
        stage.paint(coloring("unseen", seen).colors)
        picture = Box(cell.x, cell.y + caption, cell.width, cell.height - caption)
        eye = stage.eye(stage.views()["perspective"], picture.size, with_rig=False)
        image = stage.picture(
            eye, picture.size, pixel=max(0.8, 0.6 * sheet.unit), cut_away=stage.is_room
        )
        sheet.paste(image, picture.x, picture.y)
        sheet.frame(picture)
        line, value = picture.y - sheet.units(7), seen.share(seen.map.counts > 0)
        left = cell.width - sheet.text_width(value, 16) - sheet.units(8)
        sheet.text(
            picture.x, line, sheet.shortened(seen.model.name, left, 17, bold=True), size=17,
            bold=True, anchor="ls",
        )  # fmt: skip
        sheet.text(picture.right, line, value, size=16, anchor="rs")
    return sheet

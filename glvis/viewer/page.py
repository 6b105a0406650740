"""Makes report.html: one page with the scene, the maps and the tables, opened from disk.

Everything that the page shows is handed over as ``PageData``; nothing here knows of studies,
searches or OpenGL. The page's own text, style and scripts lie beside this module.
"""

from __future__ import annotations

import base64
import json
from functools import cache
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from glvis.viewer.packing import packed
from glvis.viewer.page_data import PageData
from glvis.visibility.glsl import shader_source

_VIEWER = Path(__file__).resolve().parent
# One script, in this order: a page opened from disk may not import modules from beside it.
_SCRIPTS = ("math", "mesh", "coverage", "draw", "camera", "glyphs", "panel", "controls", "main")
_SHADERS = tuple(
    f"viewer_{name}.{stage}.glsl" for name in ("mesh", "id", "line") for stage in ("vert", "frag")
)


def write_page(path: Path, data: PageData) -> None:
    """Write the page, UTF-8; it needs no other file and no network.

    Raises
    ------
    ValueError
        If there is no model, or a map, a face or a table row has the wrong shape.
    """
    path.write_text(page_text(data), encoding="utf-8")


def page_text(data: PageData) -> str:
    """Return the page's HTML; see ``write_page``."""
    study, meshes = packed(data)
    return Template(_viewer_file("page.html")).substitute(
        title=escape(data.title),
        style=_viewer_file("viewer.css"),
        study=_json_in_html(study),
        meshes=base64.b64encode(meshes).decode(),
        script=_script(),
    )


@cache
def _viewer_file(name: str) -> str:
    return (_VIEWER / name).read_text(encoding="utf-8")


@cache
def _script() -> str:
    """Return the page's script: the shaders as strings, then all parts in order."""
    shaders = {name: shader_source(name) for name in _SHADERS}
    parts = [f"const SHADERS = {_json_in_html(shaders)};"]
    parts += [_viewer_file(f"{name}.js") for name in _SCRIPTS]
    return "\n".join(parts)


def _json_in_html(value: Any) -> str:
    """Return JSON that may stand inside a script element: nothing in it can close the element."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")

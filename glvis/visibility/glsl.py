"""Finds and reads the shader files; the text itself is never in Python."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

_HERE = Path(__file__).resolve().parents[1]  # glvis
_WHEEL, _CHECKOUT = _HERE / "shaders", _HERE.parent / "shaders"  # see pyproject.toml
SHADER_DIR = _WHEEL if _WHEEL.is_dir() else _CHECKOUT

_INCLUDE = re.compile(r'^#include "([^"]+)"$')


@cache
def shader_source(name: str, *defines: str) -> str:
    """Return the text of ``shaders/<name>``, with names defined under its version line.

    A line ``#include "other.glsl"`` stands for the text of ``shaders/other.glsl``. The driver's
    messages keep the line numbers of the file; of included ones they tell source string 1.
    """
    first, rest = (SHADER_DIR / name).read_text(encoding="utf-8").split("\n", 1)
    lines = [first, *(f"#define {define}" for define in defines), "#line 2 0"]
    for number, line in enumerate(rest.split("\n"), start=2):
        included = _INCLUDE.match(line)
        if included:
            text = (SHADER_DIR / included[1]).read_text(encoding="utf-8").rstrip("\n")
            lines += ["#line 1 1", text, f"#line {number + 1} 0"]
        else:
            lines.append(line)
    return "\n".join(lines)

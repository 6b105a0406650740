"""Finds and reads the shader files; the text itself is never in Python."""

from __future__ import annotations

from functools import cache
from pathlib import Path

_HERE = Path(__file__).resolve().parents[1]  # glvis
_WHEEL, _CHECKOUT = _HERE / "shaders", _HERE.parent / "shaders"  # see pyproject.toml
SHADER_DIR = _WHEEL if _WHEEL.is_dir() else _CHECKOUT


@cache
def shader_source(name: str, *defines: str, version: int = 0) -> str:
    """Return the text of ``shaders/<name>``, with names defined under its version line.

    Where a definition needs more than the file's own version, ``version`` replaces it.

    The driver's messages keep the line numbers of the file.
    """
    text = (SHADER_DIR / name).read_text(encoding="utf-8")
    first, rest = text.split("\n", 1)
    first = f"#version {version} core" if version else first
    lines = [first, *(f"#define {define}" for define in defines), "#line 2", rest]
    return "\n".join(lines)

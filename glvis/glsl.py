"""Finds and reads the shader files; the text itself is never in Python."""

from __future__ import annotations

from functools import cache
from pathlib import Path

_HERE = Path(__file__).resolve().parent
_WHEEL, _CHECKOUT = _HERE / "shaders", _HERE.parent / "shaders"  # see pyproject.toml
SHADER_DIR = _WHEEL if _WHEEL.is_dir() else _CHECKOUT


@cache
def shader_source(name: str) -> str:
    """Return the text of ``shaders/<name>``."""
    return (SHADER_DIR / name).read_text(encoding="utf-8")

"""Words from elsewhere in one line, as titles, names and messages are."""

from __future__ import annotations

import unicodedata

_BREAKS = ("Cc", "Zl", "Zp")  # control characters, line and paragraph separators


def one_line(text: str) -> str:
    """Return a text with a space in place of line breaks, control characters and many spaces."""
    return " ".join("".join(" " if unicodedata.category(c) in _BREAKS else c for c in text).split())

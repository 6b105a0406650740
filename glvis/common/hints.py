"""What people are told to type: commands with their paths in quotes, and how extras come."""

from __future__ import annotations

import os
import shlex
import subprocess


def command(*words: object) -> str:
    """Return a command of glvis that can be pasted, whatever its paths are called.

    Parameters
    ----------
    *words : object
        Such as "render" and the path of a folder.
    """
    texts = ["glvis", *map(str, words)]
    # Windows' shells know double quotes only
    return subprocess.list2cmdline(texts) if os.name == "nt" else shlex.join(texts)


def installed_by(extra: str) -> str:
    """Return how an optional part is installed; never from an index: its glvis is another one."""
    return (
        f'install it by: pip install ".[{extra}]" in the checkout of glvis, or pip install '
        f'"WHEEL[{extra}]" with the path of its wheel'
    )

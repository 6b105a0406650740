"""What this machine has of all that glvis needs, in lines that fit into a report of a fault."""

from __future__ import annotations

import ctypes
import os
import platform
from collections.abc import Iterator

from glvis.results.result import versions
from glvis.visibility.context import gl_info
from glvis.visibility.selftest import check_driver

_LIBRARIES = {"libEGL.so.1": "EGL", "libGL.so.1": "OpenGL", "libOSMesa.so.8": "OSMesa, optional"}


def health() -> Iterator[str]:
    """Yield what is there, line by line; the driver last.

    Raises
    ------
    MachineError
        Where there is no OpenGL or a driver that draws wrongly, with what to install.
    """
    yield ", ".join(f"{name} {version or '?'}" for name, version in versions().items())
    yield f"{platform.platform()}, {os.cpu_count()} cores"
    for name, what in _LIBRARIES.items():
        yield f"{name} ({what}): {'found' if _is_there(name) else 'not found'}"
    yield f"GLVIS_GL = {os.environ.get('GLVIS_GL') or 'not set: EGL first, then OSMesa'}"
    gl = gl_info()
    yield f"OpenGL: {gl.renderer}, {gl.version} ({gl.vendor}, by {gl.backend})"
    check_driver()
    yield "The driver draws the known scene of the self-test as it should"


def _is_there(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True

"""The one OpenGL context of a process: EGL without a window first, OSMesa as the fallback.

A context belongs to its process for life: glcontext cannot end an EGL display, and a forked
child of a process that has one hangs. Workers are therefore spawned, never forked.
The environment variable GLVIS_GL = egl | osmesa chooses the way; without it both are tried.
"""

from __future__ import annotations

import ctypes
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import glcontext
import moderngl

from glvis.errors import MachineError

_ENVIRONMENT = "GLVIS_GL"
_MAX_EGL_DEVICES = 32
_GL_VERSION = 330  # core profile that every driver of the last fifteen years runs
# Asked for in this order: some drivers give just the version asked for, others their latest.
_GL_VERSIONS = (460, 450, 430, _GL_VERSION)
_INSTALL_HINT = (
    "on Debian or Ubuntu: apt-get install libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri, "
    "or libosmesa6 for OSMesa"
)


@dataclass(frozen=True)
class GlInfo:
    """The OpenGL driver in use: as it names itself, and the way the context was made."""

    vendor: str
    renderer: str
    version: str
    backend: str

    @property
    def is_software(self) -> bool:
        """Whether the driver rasterises on the CPU."""
        return any(word in self.renderer.lower() for word in ("llvmpipe", "softpipe", "swrast"))


@cache
def gl_context() -> moderngl.Context:
    """Return this process's context, made on the first call.

    Raises
    ------
    MachineError
        Where neither way gives an OpenGL 3.3 core context; the message has each way's own
        words and the packages to install.
    """
    wanted = os.environ.get(_ENVIRONMENT, "").strip().lower()
    ways = {"egl": _egl_context, "osmesa": _osmesa_context}
    if wanted and wanted not in ways:
        raise MachineError(f"{_ENVIRONMENT} = '{wanted}' must be one of egl, osmesa, or unset")
    failures = []
    for name in [wanted] if wanted else list(ways):
        try:
            context = ways[name]()
        except Exception as error:  # glcontext raises bare Exception
            failures.append(f"{name}: {' '.join(str(error).split())}")
            continue
        context.gc_mode = "auto"
        context.extra = name
        return context
    raise MachineError(f"no OpenGL 3.3 context ({'; '.join(failures)}); {_INSTALL_HINT}")


def gl_info() -> GlInfo:
    """Return who draws in this process."""
    context = gl_context()
    info = context.info
    return GlInfo(info["GL_VENDOR"], info["GL_RENDERER"], info["GL_VERSION"], context.extra)


@contextmanager
def rasterising_in_this_thread() -> Iterator[None]:
    """Make a context, if one is made here, that starts no threads of its own on the CPU.

    llvmpipe's threads cost more than they give on images of the size that maps need. The user's
    own word on them holds; the variable is read when the context is made.
    """
    name = "LP_NUM_THREADS"
    is_set = name in os.environ
    if not is_set:
        os.environ[name] = "0"
    try:
        yield
    finally:
        if not is_set:
            del os.environ[name]


class Held(ABC):
    """A holder of GPU memory, or processes, until the end of a ``with``."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()

    @abstractmethod
    def release(self) -> None:
        """Give back what is held."""


def unbind_framebuffer() -> None:
    """Bind a framebuffer that is never released; to be called before one is.

    moderngl binds what was bound before whenever it makes something, and a name that is gone
    is an OpenGL error.
    """
    _resting_place().use()


@cache
def _resting_place() -> moderngl.Framebuffer:
    return gl_context().simple_framebuffer((1, 1))


def _egl_context() -> moderngl.Context:
    """Return a context on the first EGL device that can draw.

    Mesa lists its software device after the hardware ones, and glcontext takes one index
    and gives up where that device is unusable, so every index is tried.
    """
    make = glcontext.get_backend_by_name("egl")
    failure: Exception = RuntimeError("no device")
    for device_index in range(_MAX_EGL_DEVICES):
        try:
            return _latest(make, device_index)
        except Exception as error:
            failure = error if device_index == 0 else failure
            found = re.search(r"requested device index \d+, but found (\d+)", str(error))
            if found:  # past the end of the list: the first device's words say more
                if device_index == 0:
                    failure = RuntimeError(f"found {found[1]} EGL devices")
                break
            if "not loaded" in str(error) or "not found" in str(error).lower():
                break  # the library itself is missing: no index will help
    raise failure


def _latest(make: Any, device_index: int) -> moderngl.Context:
    """Return a context of the latest version that an EGL device has."""
    for version in _GL_VERSIONS:
        try:
            native = _with_library_names(make, device_index, version)
            context = moderngl.create_context(require=version, context=native)
            _probe(context)
        except Exception:
            if version == _GL_VERSIONS[-1]:
                raise
        else:
            return context
    raise AssertionError("the last version returns or raises")


def _with_library_names(make: Any, device_index: int, version: int) -> Any:
    """Return a native EGL context; versioned names first, slim images have no others."""
    try:
        return make(
            mode="standalone",
            glversion=version,
            device_index=device_index,
            libegl="libEGL.so.1",
            libgl="libGL.so.1",
        )
    except Exception as error:
        if "libEGL" not in str(error) and "libGL" not in str(error):
            raise
        return make(mode="standalone", glversion=version, device_index=device_index)


def _osmesa_context() -> moderngl.Context:
    """Return an off-screen Mesa context; Mesa had OSMesa up to 25.0."""
    native: Any = _OSMesa()
    context = moderngl.create_context(require=_GL_VERSION, context=native)
    _probe(context)
    return context


def _probe(context: moderngl.Context) -> None:
    """Clear one pixel and read it back: a device that cannot do this is not usable."""
    target = context.simple_framebuffer((1, 1))
    target.clear(1.0, 0.0, 0.0, 1.0)
    pixel = target.read()
    target.release()
    if pixel != b"\xff\x00\x00":
        raise RuntimeError(f"a red pixel was read back as {list(pixel)}")


class _OSMesa:
    """OSMesa through moderngl's custom-context protocol.

    moderngl asks for ``load_opengl_function``, ``__enter__``, ``__exit__`` and ``release``.
    """

    _FORMAT, _DEPTH_BITS, _PROFILE, _CORE = 0x22, 0x30, 0x33, 0x34  # GL/osmesa.h
    _MAJOR, _MINOR, _RGBA, _UNSIGNED_BYTE = 0x36, 0x37, 0x1908, 0x1401

    def __init__(self) -> None:
        self._library = self._loaded_library()
        self._library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        self._library.OSMesaCreateContextAttribs.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        self._library.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p, ctypes.c_void_p] + [
            ctypes.c_int
        ] * 3
        self._library.OSMesaGetProcAddress.restype = ctypes.c_void_p
        self._library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        wanted = [self._FORMAT, self._RGBA, self._DEPTH_BITS, 24, self._PROFILE, self._CORE]
        wanted += [self._MAJOR, _GL_VERSION // 100, self._MINOR, _GL_VERSION // 10 % 10, 0]
        self._handle = self._library.OSMesaCreateContextAttribs(
            (ctypes.c_int * len(wanted))(*wanted), None
        )
        if not self._handle:
            raise RuntimeError("OSMesa made no 3.3 core context")
        self._screen = (ctypes.c_ubyte * 64)()  # the 4 x 4 default framebuffer, never drawn to
        self.__enter__()

    @staticmethod
    def _loaded_library() -> ctypes.CDLL:
        names = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
        for name in names:
            try:
                return ctypes.CDLL(name)
            except OSError:
                continue
        raise RuntimeError(f"{names[0]} not found")

    def load_opengl_function(self, name: str) -> int:
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    def __enter__(self) -> None:
        if not self._library.OSMesaMakeCurrent(
            self._handle, self._screen, self._UNSIGNED_BYTE, 4, 4
        ):
            raise RuntimeError("OSMesa did not make its context current")

    def __exit__(self, *exception: object) -> None:
        pass

    def release(self) -> None:
        pass

"""Ask whether OpenGL can be had here without a display: exit code 0, or 1 and one line why.

Does what a program would do, on every device that EGL names: libraries alone prove nothing where
the driver behind them is missing. Uses nothing but the standard library.
"""

import ctypes
import sys

EGL_PLATFORM_DEVICE = 0x313F
MANY = 32


def open_devices() -> int:
    """Return how many of EGL's devices could be initialised; raises OSError without libraries."""
    ctypes.CDLL("libGL.so.1")
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]

    def function(name: bytes, result: type, *arguments: type):
        address = egl.eglGetProcAddress(name)
        if not address:
            raise OSError(f"EGL has no {name.decode()}")
        return ctypes.CFUNCTYPE(result, *arguments)(address)

    pointer, integer = ctypes.c_void_p, ctypes.c_int
    query = function(b"eglQueryDevicesEXT", integer, integer, pointer, pointer)
    display_of = function(b"eglGetPlatformDisplayEXT", pointer, integer, pointer, pointer)
    initialize = function(b"eglInitialize", integer, pointer, pointer, pointer)
    terminate = function(b"eglTerminate", integer, pointer)
    devices, count = (pointer * MANY)(), integer()
    if not query(MANY, devices, ctypes.byref(count)):
        return 0
    working = 0
    for device in devices[: count.value]:
        display = display_of(EGL_PLATFORM_DEVICE, device, None)
        if display and initialize(display, None, None):
            working += 1
            terminate(display)
    return working


def main() -> int:
    """Say what is missing, if anything is."""
    try:
        working = open_devices()
    except OSError as error:
        print(f"EGL cannot be used: {error}", file=sys.stderr)
        return 1
    if not working:
        print("EGL is here, but none of its devices has a driver that works", file=sys.stderr)
    return 0 if working else 1


if __name__ == "__main__":
    sys.exit(main())

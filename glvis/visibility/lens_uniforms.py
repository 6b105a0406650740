"""A viewpoint's lens as ``lens.glsl`` has it: one uniform block."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from glvis.problem.calibrated_lens import CalibratedLens, FisheyeLens, OpenCVLens
from glvis.problem.lens import Pinhole, SphericalLens
from glvis.visibility.filters import Limits

# The block Lens of lens.glsl, name by name.
LENS = np.dtype(
    [
        ("image", "f4", 4),
        ("coefficients", "f4", 8),
        ("end", "f4"),
        ("kind", "i4"),
        ("by_range", "i4"),
        ("filler", "u4"),
    ]
)
_PINHOLE, _OPENCV, _FISHEYE, _SPHERICAL = range(4)  # as lens.glsl has them
_NO_END = 1e9  # a tangent beyond all that float32 tells from 90 degrees


def lens_uniforms(limits: Limits) -> NDArray[np.void] | None:
    """Return the lens and range of a viewpoint, (1,) LENS; None where the window says it all."""
    lens = limits.lens
    if isinstance(lens, Pinhole) and not limits.by_range:
        return None
    block = np.zeros(1, dtype=LENS)
    block["by_range"] = limits.by_range
    if isinstance(lens, CalibratedLens):
        width, height = lens.size
        x, y = ((c + 0.5) / n for c, n in zip(lens.centre_px, lens.size, strict=True))
        block["image"] = lens.focal_px[0] / width, lens.focal_px[1] / height, x, y
        block["coefficients"][0, : len(lens.coefficients)] = lens.coefficients
    if isinstance(lens, OpenCVLens):
        block["kind"] = _OPENCV
        block["end"] = math.tan(lens.end) if lens.end < math.atan(_NO_END) else _NO_END
    elif isinstance(lens, FisheyeLens):
        block["kind"] = _FISHEYE
        block["end"] = min(lens.end, math.pi)
    elif isinstance(lens, SphericalLens):
        block["kind"] = _SPHERICAL
        block["image"] = lens.azimuth, *lens.elevation, 0.0
    else:
        block["kind"] = _PINHOLE
    return block

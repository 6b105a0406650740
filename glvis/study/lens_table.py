"""The keys of a study file that say a lens, and the lens they mean; and the other way round."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

import numpy as np

from glvis.common.values import Centre, Coefficient, Focal, Opening, Size, between, within
from glvis.problem.calibrated_lens import CalibratedLens, FisheyeLens, OpenCVLens
from glvis.problem.lens import Lens, Pinhole, SphericalLens
from glvis.study.table import Table

_PAIR = within("be [x, y]", lambda v: len(v) == 2)
_LOW_HIGH = within("be [low, high]", lambda v: len(v) == 2)
_MOST_COEFFICIENTS = 14  # as many as OpenCV has; the lens says how many it takes
_CENTRED = 1e-9  # pixels
# Which keys go with which lens.
_TAKEN = {
    "pinhole": ("hfov_deg", "vfov_deg", "focal_px", "centre_px", "max_angle_deg"),
    "opencv": ("focal_px", "centre_px", "distortion", "max_angle_deg"),
    "fisheye": ("focal_px", "centre_px", "distortion", "max_angle_deg"),
    "spherical": ("azimuth_deg", "elevation_deg"),
}
_ANGLES = ("hfov_deg", "vfov_deg")
LENS_KEYS = ("lens", *dict.fromkeys(key for keys in _TAKEN.values() for key in keys))


class LensTable(Table):
    """The keys of a lens, which a sensor and its partner have in common."""

    lens: Literal["pinhole", "opencv", "fisheye", "spherical"] = "pinhole"
    hfov_deg: Opening | None = None
    vfov_deg: Opening | None = None
    focal_px: Annotated[list[Focal], _PAIR] | None = None
    centre_px: Annotated[list[Centre], _PAIR] | None = None
    distortion: (
        Annotated[
            list[Coefficient],
            within(
                f"have at most {_MOST_COEFFICIENTS} numbers", lambda v: len(v) <= _MOST_COEFFICIENTS
            ),
        ]
        | None
    ) = None
    max_angle_deg: (
        Annotated[float, within("lie in (0, 180]", lambda v: 1e-12 <= v <= 180)] | None
    ) = None
    azimuth_deg: Annotated[float, within("lie in (0, 360]", lambda v: 1e-12 <= v <= 360)] | None = (
        None
    )
    elevation_deg: Annotated[list[Annotated[float, between(-90, 90)]], _LOW_HIGH] | None = None
    resolution: Size | None = None

    @property
    def has_lens(self) -> bool:
        """Whether the file says anything of a lens here."""
        return any(key in LENS_KEYS for key in self.given())

    def to_lens(self, size: tuple[int, int]) -> Lens:
        """Return the lens, whose pixels are those of an image of ``size``.

        Raises
        ------
        ValueError
            Of keys that do not go together, or are missing.
        """
        for key in LENS_KEYS:
            if key not in ("lens", *_TAKEN[self.lens]) and getattr(self, key) is not None:
                kinds = " or ".join(f"'{kind}'" for kind, keys in _TAKEN.items() if key in keys)
                raise ValueError(f"{key}: goes with lens = {kinds}, here it is '{self.lens}'")
        if self.lens == "spherical":
            if self.azimuth_deg is None or self.elevation_deg is None:
                raise self._missing("azimuth_deg" if self.azimuth_deg is None else "elevation_deg")
            low, high = map(math.radians, self.elevation_deg)
            return SphericalLens(math.radians(self.azimuth_deg), (low, high))
        if self.lens == "pinhole" and self.focal_px is None:
            return self._from_angles(size)
        return self._from_pixels(size)

    def _missing(self, key: str) -> ValueError:
        who = "" if self.lens == "pinhole" else f", lens = '{self.lens}' needs it"
        return ValueError(f"'{key}' is missing{who}")

    def _from_angles(self, size: tuple[int, int]) -> Lens:
        """Return the pinhole of opening angles."""
        if self.hfov_deg is None and self.vfov_deg is None:
            raise ValueError("'hfov_deg' and 'vfov_deg' are missing; or focal_px, or another lens")
        if self.hfov_deg is None or self.vfov_deg is None:
            raise self._missing("hfov_deg" if self.hfov_deg is None else "vfov_deg")
        if self.centre_px is not None:
            raise ValueError("centre_px: goes with focal_px, not with hfov_deg and vfov_deg")
        pinhole = Pinhole.from_degrees(self.hfov_deg, self.vfov_deg)
        if self.max_angle_deg is None:
            return pinhole
        x, y = pinhole.focal
        angle = math.radians(self.max_angle_deg)
        return OpenCVLens(size, (size[0] * x, size[1] * y), _middle(size), (), angle)

    def _from_pixels(self, size: tuple[int, int]) -> Lens:
        """Return the lens of a focal length in pixels."""
        if self.focal_px is None:
            raise self._missing("focal_px")
        if self.hfov_deg is not None or self.vfov_deg is not None:
            raise ValueError("hfov_deg and vfov_deg, or focal_px, not both")
        focal_px, centre_px = _pair(self.focal_px), _pair(self.centre_px or _middle(size))
        if self.lens == "pinhole" and self.max_angle_deg is None:
            return lens_without_distortion(size, focal_px, centre_px)
        kind = FisheyeLens if self.lens == "fisheye" else OpenCVLens
        angle = math.pi if self.max_angle_deg is None else math.radians(self.max_angle_deg)
        lens = kind(size, focal_px, centre_px, tuple(self.distortion or ()), angle)
        refuse_blind(lens)
        return lens


def lens_of(table: Mapping[str, Any]) -> Lens:
    """Return the lens of a sensor's table; a spherical one needs no resolution for it."""
    width, height = table.get("resolution", (1, 1))
    keys = {key: table[key] for key in LENS_KEYS if key in table}
    return LensTable.model_validate(keys).to_lens((width, height))


def lens_without_distortion(
    size: tuple[int, int], focal_px: tuple[float, float], centre_px: tuple[float, float]
) -> Lens:
    """Return the ideal pinhole of numbers in pixels; of OpenCV's kind where it is off-centre."""
    off = np.subtract(centre_px, _middle(size))
    if np.abs(off).max() > _CENTRED:
        return OpenCVLens(size, focal_px, centre_px, ())
    return Pinhole.from_tangents(size[0] / (2 * focal_px[0]), size[1] / (2 * focal_px[1]))


def refuse_blind(lens: Lens) -> None:
    """Refuse a lens that has no ray even in the middle of its image.

    Raises
    ------
    ValueError
        The bare fact.
    """
    with np.errstate(all="ignore"):
        if not np.isfinite(lens.directions(0.5, 0.5)).all():
            raise ValueError(
                "the middle of the image has no ray: focal_px, centre_px, distortion and "
                "max_angle_deg are not those of one lens"
            )


def lens_keys(lens: Lens, size: tuple[int, int], as_angles: bool = False) -> dict[str, Any]:
    """Return the keys of a lens for an image of some size, the inverse of ``LensTable.to_lens``.

    Parameters
    ----------
    lens : Lens
        Any.
    size : tuple of int
        Pixels (width, height) of the image, which those of the lens become.
    as_angles : bool
        Whether a pinhole is to be in opening angles, also where a focal length is exacter.
    """
    if isinstance(lens, Pinhole):
        return _pinhole_keys(lens, size, as_angles)
    if isinstance(lens, SphericalLens):
        return {
            "lens": lens.kind,
            "azimuth_deg": degrees_of(lens.azimuth),
            "elevation_deg": [degrees_of(angle) for angle in lens.elevation],
        }
    if not isinstance(lens, CalibratedLens):
        raise ValueError(f"a lens of kind {type(lens).__name__} has no keys in a study")
    if lens.size != size:
        lens = lens.at_size(size)
    coefficients = list(lens.coefficients)
    while coefficients and coefficients[-1] == 0:
        coefficients.pop()
    counts = (0, 4) if isinstance(lens, FisheyeLens) else (0, 4, 5, 8)
    n = min(count for count in counts if count >= len(coefficients))
    keys: dict[str, Any] = {"lens": lens.kind, "focal_px": list(lens.focal_px)}
    keys["centre_px"] = list(lens.centre_px)
    if n:
        keys["distortion"] = list(lens.coefficients[:n])
    if lens.max_angle < math.pi:
        keys["max_angle_deg"] = degrees_of(lens.max_angle)
    return keys


def _pinhole_keys(lens: Pinhole, size: tuple[int, int], as_angles: bool) -> dict[str, Any]:
    """Return opening angles where they give the very same pinhole, else focal lengths."""
    degrees = [degrees_of(angle) for angle in (lens.hfov, lens.vfov)]
    keys = dict(zip(_ANGLES, degrees, strict=True))
    if as_angles or Pinhole.from_degrees(*degrees) == lens:
        return keys
    focal = [
        shortest(n * share, lambda f, n=n: 2 * math.atan(n / (2 * f)), angle)  # type: ignore[misc]
        for n, share, angle in zip(size, lens.focal, (lens.hfov, lens.vfov), strict=True)
    ]
    is_same = lens_without_distortion(size, _pair(focal), _middle(size)) == lens
    return {"focal_px": focal} if is_same else keys


def degrees_of(radians: float) -> float:
    """Return an angle in degrees that becomes the very same in radians, in the fewest digits."""
    return shortest(math.degrees(radians), math.radians, radians)


def shortest(value: float, back: Callable[[float], float], target: float) -> float:
    """Return a number near ``value`` of the fewest digits for which ``back`` of it is ``target``.

    Not every number has one that leads to it: then it is ``value``.
    """
    near = [float(f"{value:.{digits}g}") for digits in range(3, 18)]
    below = above = value
    for _ in range(4):  # units in the last place; products with pi / 180 round by one or two
        below, above = math.nextafter(below, -math.inf), math.nextafter(above, math.inf)
        near += [below, above]
    return next((number for number in near if back(number) == target), value)


def _middle(size: tuple[int, int]) -> tuple[float, float]:
    """Return the middle of an image; pixel centres have whole numbers."""
    return (size[0] - 1) / 2, (size[1] - 1) / 2


def _pair(values: Any) -> tuple[float, float]:
    return float(values[0]), float(values[1])

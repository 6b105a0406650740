"""What counts as visible, and the maps that say which sensor sees which face."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.inputs.scene import Model
from glvis.inputs.sensor import Sensor

# What ``semantics = "paper"`` means for the other options (Sec. 2.1.1).
_PAPER: dict[str, Any] = {"criterion": "centroid", "incidence": "axis", "occlusion": "paper"}


@dataclass(frozen=True)
class VisibilityOptions:
    """Which faces count as seen.

    Attributes
    ----------
    criterion : str
        "pixels": the face shows in at least ``min_pixels`` pixels. "centroid": nothing hides
        its centre of mass, the paper's rule.
    min_pixels : int
        For "pixels".
    resolution : str or tuple of int
        Pixels of a render: "auto", "sensor" (its own) or (width, height).
    incidence : str
        Angle between the normal and the true "ray" or the optical "axis".
    occlusion : str
        "physical": refused faces still hide what lies behind them. "paper": faces refused by
        CropBack and CropNorm hide nothing.
    semantics : str
        "" or "paper": every choice of the paper at once; see ``paper``.
    """

    criterion: str = "pixels"
    min_pixels: int = 1
    resolution: str | tuple[int, int] = "auto"
    incidence: str = "ray"
    occlusion: str = "physical"
    semantics: str = ""

    def __post_init__(self) -> None:
        for name, allowed in _WORDS.items():
            if getattr(self, name) not in allowed:
                choice = " or ".join(f"'{word}'" for word in allowed)
                raise ValueError(f"{name} = '{getattr(self, name)}' must be {choice}")
        if not isinstance(self.resolution, str):
            object.__setattr__(self, "resolution", tuple(self.resolution))
        if self.min_pixels < 1:
            raise ValueError(f"min_pixels = {self.min_pixels} must be at least 1")
        if isinstance(self.resolution, str):
            if self.resolution not in ("auto", "sensor"):
                raise ValueError(
                    f"resolution = '{self.resolution}' must be 'auto', 'sensor' or [width, height]"
                )
        elif len(self.resolution) != 2 or min(self.resolution) < 1:
            raise ValueError(f"resolution = {list(self.resolution)} must be at least [1, 1]")
        if self.semantics == "paper":
            for name, meant in _PAPER.items():
                if getattr(self, name) != meant:
                    raise ValueError(
                        f"{name} = '{getattr(self, name)}' contradicts semantics = 'paper', "
                        f"which means '{meant}'"
                    )

    @classmethod
    def paper(cls, resolution: str | tuple[int, int] = "auto") -> VisibilityOptions:
        """Return the paper's choices: centroid, occlusion paper, incidence by the axis."""
        return cls(resolution=resolution, semantics="paper", **_PAPER)


_WORDS = {
    "criterion": ("pixels", "centroid"),
    "incidence": ("ray", "axis"),
    "occlusion": ("physical", "paper"),
    "semantics": ("", "paper"),
}


@dataclass(frozen=True, eq=False)
class VisibilityMap:
    """Which sensor sees which face of one model: the paper's VM, Sec. 2.1.2.

    Attributes
    ----------
    model_name : str
        Stem of the model's file.
    sensor_names : tuple of str
        Names of the S sensors.
    visible : (S, F) bool
        In the face order of the file.
    """

    model_name: str
    sensor_names: tuple[str, ...]
    visible: NDArray[np.bool_]

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of sensors that see each face, (F,)."""
        return self.visible.sum(axis=0)

    @property
    def n_unique(self) -> int:
        """Number of faces that at least one sensor sees."""
        return int(np.count_nonzero(self.visible.any(axis=0)))

    @property
    def n_total(self) -> int:
        """Faces seen, each counted once for every sensor that sees it: T_tot, Eq. (6)."""
        return int(np.count_nonzero(self.visible))

    @property
    def coverage(self) -> float:
        """Share of the faces that at least one sensor sees: OF1, Eq. (1)."""
        return self.n_unique / self.visible.shape[1]

    def share_seen_by(self, n: int) -> float:
        """Return the share of the faces that at least ``n`` sensors see."""
        return float(np.count_nonzero(self.counts >= n)) / self.visible.shape[1]


# Pixels that a typical face's side spans at maxD when the resolution is "auto". Both come from
# rays to 64 points of every face of six arms, see tools/bench: with the second look the pixels
# criterion then misses less than 0.1 % of the faces that are at least half visible.
_PIXELS_A_SIDE = {"pixels": 1.5, "centroid": 1.2}
# Pixels along the longer side, at least: in a room, a coarse image leaves out faces of which little
# shows beside larger ones. By tools/bench --only kitchen, run with other values here, "pixels"
# misses 3.1 % of all of which anything shows with 104 pixels, 2.3 with 128, 0.9 with 256 and 0.2
# with 512, at 4.4 times the time of 104; "centroid" has an IoU of 0.982, 0.991, 0.995 and 0.998
# with rays to the centres.
_SMALLEST = 256


def render_resolution(options: VisibilityOptions, sensor: Sensor, model: Model) -> tuple[int, int]:
    """Return the pixels (width, height) that a sensor's view of a model is rendered at.

    "auto" is an image of 256 pixels along its longer side, of more where a side of a typical face
    would span too few at the far end of the working range, and never of more than the sensor has.
    """
    if not isinstance(options.resolution, str):
        return options.resolution
    # Counting more than one pixel a face means the sensor's own pixels.
    if options.resolution == "sensor" or options.min_pixels > 1:
        return sensor.resolution
    # square pixels, so that the finer axis does not pay for the coarser one
    tan_x, tan_y = sensor.intrinsics.tan_half
    focal = _PIXELS_A_SIDE[options.criterion] * sensor.max_distance / model.mean_edge
    focal = max(focal, _SMALLEST / 2 / float(max(tan_x, tan_y)))
    width, height = sensor.resolution
    return (
        min(width, math.ceil(2 * focal * float(tan_x))),
        min(height, math.ceil(2 * focal * float(tan_y))),
    )


def takes_second_look(options: VisibilityOptions) -> bool:
    """Return whether faces that show in no pixel are looked at once more by their centres.

    At "auto" the image is coarser than the sensor's; a face between its pixels still counts
    where its centre of mass is free. At a stated resolution pixels alone decide.
    """
    return (
        options.criterion == "pixels" and options.resolution == "auto" and options.min_pixels == 1
    )

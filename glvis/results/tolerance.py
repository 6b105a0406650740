"""What a layout is worth when it is not mounted exactly as planned.

Every sensor is disturbed by itself, twins of mirrored mounts too: each has its own bolts.
Positions move along the world's axes; tilt, pan and roll turn about the image's right and up
axes and the optical axis.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glvis.errors import StudyError
from glvis.evaluation.evaluator import Evaluator
from glvis.problem.pieces import noun_of_shares, share_of
from glvis.problem.units import MM_PER_UNIT
from glvis.results.mounting import Setting, pose_of_setting, setting_of_pose
from glvis.search.placement import Placement
from glvis.visibility.visibility_map import VisibilityMap

Floats = NDArray[np.float64]

# The six ways to be wrong, in the order of the columns of ``Sensitivity.losses``.
AXES = ("x", "y", "z", "tilt", "pan", "roll")
_QUANTITY = re.compile(r"([-+0-9.eE]*[0-9.])\s*([a-z]*)")


@dataclass(frozen=True)
class Worth:
    """What a layout is worth.

    Attributes
    ----------
    coverage : float
        Share of the faces, or of the area where some were cut, that at least one sensor sees; the
        mean over models.
    value : float
        Of the objective.
    """

    coverage: float
    value: float


def worth(placement: Placement, maps: list[VisibilityMap] | None = None) -> Worth:
    """Return what a placement's maps, or others of its study, are worth."""
    study = placement.study
    found = list(placement.maps) if maps is None else maps
    values = study.objective.value_by_model(
        [one.counts for one in found], [model.areas for model in study.models]
    )
    noun = noun_of_shares(study.models, study.objective.by_area)
    shares = [
        share_of(model, one.counts > 0, noun)
        for one, model in zip(found, study.models, strict=True)
    ]
    coverage = float(np.mean(shares))
    return Worth(coverage, float(study.objective.aggregated(values)))


def disturbed(pose: Floats, shift: Floats, turn: Floats) -> Floats:
    """Return poses (..., 4, 4) moved by ``shift`` and turned by ``turn``.

    Parameters
    ----------
    pose : (..., 4, 4) float64
        Camera to world.
    shift : (..., 3) float64
        Along the world's axes, the study's unit.
    turn : (..., 3) float64
        Rotation vector about the camera's x (tilt up), y (pan left) and z axis, radians.
        The optical axis is -z: roll by the right-hand rule about it is minus the third.
    """
    result = np.array(np.broadcast_to(pose, (*np.shape(shift)[:-1], 4, 4)), dtype=float)
    angle = np.linalg.norm(turn, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(np.asarray(turn, dtype=float), -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    # Rodrigues; sinc keeps small angles exact
    sine = np.sinc(angle / math.pi)
    half = np.sinc(angle / (2 * math.pi)) ** 2 / 2
    rotation = np.eye(3) + sine * cross + half * (cross @ cross)
    result[..., :3, :3] = result[..., :3, :3] @ rotation
    result[..., :3, 3] += shift
    return result


def random_errors(
    placement: Placement, position: float, angle: float, samples: int, seed: int
) -> Iterator[Worth]:
    """Yield what randomly disturbed layouts are worth.

    Parameters
    ----------
    placement : Placement
        The layout as planned.
    position : float
        Largest error along each axis, the study's unit; errors are spread evenly below it.
    angle : float
        Largest error of tilt, pan and roll, radians.
    samples : int
        Layouts to look at.
    seed : int
        Of the random numbers.
    """
    rng = np.random.default_rng(seed)
    shape = (len(placement.camera_to_world), 3)
    with Evaluator(placement.study, cache_bytes=0) as evaluator:
        for _ in range(samples):
            poses = disturbed(
                placement.camera_to_world,
                rng.uniform(-position, position, shape),
                rng.uniform(-angle, angle, shape),
            )
            yield worth(placement, evaluator.visibility_of_poses(poses))


def single_errors(placement: Placement, position: float, angle: float) -> Floats:
    """Return the coverage lost by one error of one sensor at a time, (S, 6) in the order of AXES.

    The larger loss of both directions; negative where either would gain.
    """
    poses, planned = placement.camera_to_world, worth(placement).coverage
    losses = np.full((len(poses), len(AXES)), -math.inf)
    with Evaluator(placement.study) as evaluator:
        for s, axis, sign in np.ndindex(len(poses), len(AXES), 2):
            step = np.zeros(6)
            step[axis] = (position if axis < 3 else angle) * (1 - 2 * sign)
            moved = poses.copy()
            moved[s] = disturbed(poses[s], step[:3], step[3:])
            found = worth(placement, evaluator.visibility_of_poses(moved))
            losses[s, axis] = max(losses[s, axis], planned - found.coverage)
    return losses


def without_each(placement: Placement) -> list[Worth]:
    """Return what the layout is worth with each sensor lost in turn; nothing is moved."""
    found = []
    for s in range(len(placement.camera_to_world)):
        left = []
        for one in placement.maps:
            visible = one.visible.copy()
            visible[s] = False
            left.append(VisibilityMap(one.model_name, one.sensor_names, visible))
        found.append(worth(placement, left))
    return found


def rounded_poses(placement: Placement, position: float, angle_deg: float) -> Floats:
    """Return the poses (S, 4, 4) with whole steps of position and of pan, tilt and roll.

    Parameters
    ----------
    placement : Placement
        The layout as planned.
    position : float
        Step of each coordinate, the study's unit; 0 leaves it.
    angle_deg : float
        Step of pan, tilt and roll about the study's up, degrees; 0 leaves them.
    """
    up = placement.study.up
    poses = []
    for pose in placement.camera_to_world:
        setting = setting_of_pose(pose, up)
        angles = [setting.pan_deg, setting.tilt_deg, setting.roll_deg]
        rounded = Setting(*(float(_rounded(value, angle_deg)) for value in angles))
        poses.append(pose_of_setting(_rounded(pose[:3, 3], position), rounded, up))
    return np.stack(poses)


def length_of(text: str, unit: str, option: str) -> float:
    """Return a length such as "1mm" or "0.5" in a study's unit; without one it is in that."""
    value, own = _quantity(text, option, f"a length such as 1{unit}")
    if own and own not in MM_PER_UNIT:
        raise StudyError(f"{option} {text}: '{own}' must be one of {', '.join(MM_PER_UNIT)}")
    return value * MM_PER_UNIT[own or unit] / MM_PER_UNIT[unit]


def degrees_of(text: str, option: str) -> float:
    """Return an angle such as "0.5deg" or "0.5" in degrees."""
    value, own = _quantity(text, option, "an angle such as 0.5deg")
    if own not in ("", "deg"):
        raise StudyError(f"{option} {text}: '{own}' must be deg")
    return value


def _quantity(text: str, option: str, wanted: str) -> tuple[float, str]:
    found = _QUANTITY.fullmatch(text.strip())
    try:
        value = float(found[1]) if found else -1.0
    except ValueError:
        value = -1.0
    if not (found and 0 <= value < math.inf):
        raise StudyError(f"{option} {text}: must be {wanted}, 0 or more")
    return value, found[2]


def _rounded(value: Floats | float, step: float) -> Floats | float:
    """Return the nearest whole steps, without the dust of binary fractions."""
    if step == 0:
        return value
    return np.round(np.round(np.asarray(value) / step) * step, 9 - math.floor(math.log10(step)))

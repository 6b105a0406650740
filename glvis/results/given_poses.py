"""Poses that somebody gives: another result, a table, COLMAP's images, matrices in JSON.

Matrices and quaternions of glvis' own files are camera to world with the axes x right, y up,
looking along -z; COLMAP's are world to camera with y down, looking along z.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from glvis.common.complaints import checked
from glvis.common.files import json_value, read_text
from glvis.errors import StudyError
from glvis.problem.camera import look_along, rigid_inverse
from glvis.problem.rotations import OPTICAL, Floats, rotation
from glvis.problem.study import Study
from glvis.problem.units import MM_PER_UNIT
from glvis.results.export_colmap import SECOND
from glvis.results.folder import INDEX, read_index
from glvis.results.indexes import PosesIndex
from glvis.results.reading import check_sensors, poses_of

_MOST = 64_000_000  # bytes
_KINDS = "a result or its folder, poses.csv, COLMAP's images.txt, or JSON of 4 x 4 matrices"


def read_given_poses(path: str | Path, study: Study) -> Floats:
    """Return the poses (S, 4, 4) of a study's sensors in a file, by their names.

    Parameters
    ----------
    path : str or Path
        ``result.json``, or the folder that holds one: in its own unit. ``.json`` with
        ``{"NAME": 4 x 4 matrix, ...}``, ``.csv`` with the columns name, x, y, z and either qw,
        qx, qy, qz or dx, dy, dz (and roll_deg), ``.txt`` as COLMAP writes ``images.txt`` (the
        names of images without their ending): in the study's unit.
    study : Study
        Whose S sensors; what the file has besides is left out.

    Raises
    ------
    StudyError
        If there is no such file, a sensor is not in it, or a pose is no rigid transform.
    """
    path = Path(path)
    path = path / INDEX if path.is_dir() else path
    read = _READERS.get(path.suffix.lower())
    if read is None:
        raise StudyError(f"{path}: holds no poses that can be read; they may be {_KINDS}")
    own = read_index(path) if path.name == INDEX else {}
    try:
        content = own or read(read_text(path, _MOST), study)
        poses = poses_of(checked(PosesIndex, content).poses, study.sensor_names)
        poses[:, :3, 3] *= MM_PER_UNIT[content.get("unit", study.unit)] / MM_PER_UNIT[study.unit]
        return poses
    except FileNotFoundError:
        raise StudyError(f"{path}: does not exist") from None
    except UnicodeDecodeError:
        raise StudyError(f"{path}: is no text in UTF-8; save it as UTF-8") from None
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror}") from None
    except StudyError as error:
        raise StudyError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise StudyError(f"{path}: its poses are broken: {error}; they may be {_KINDS}") from None


def _from_json(text: str, study: Study) -> Mapping[str, Any]:
    found = json_value(text)
    if not isinstance(found, dict):
        raise StudyError(f"must hold {{ sensor: 4 x 4 matrix, ... }}, or be {_KINDS}")
    if "poses" in found:
        return found
    check_sensors(found, study.sensor_names)
    return {
        "poses": [{"name": name, "camera_to_world": found[name]} for name in study.sensor_names]
    }


def _from_table(text: str, study: Study) -> Mapping[str, Any]:
    head = text.partition("\n")[0]
    rows = csv.DictReader(text.splitlines(), delimiter=";" if ";" in head else ",")
    columns = rows.fieldnames or []
    turns = next((names for names in (_QUATERNION, _DIRECTION) if names <= {*columns}), None)
    if turns is None or not {"name", *"xyz"} <= {*columns}:
        raise StudyError(
            "needs the columns name, x, y, z and qw, qx, qy, qz or dx, dy, dz (and roll_deg); "
            f"it has {', '.join(columns) or 'none'}"
        )
    return {"poses": [_row_pose(row, turns is _QUATERNION, study) for row in rows]}


def _row_pose(row: Mapping[str, str], has_quaternion: bool, study: Study) -> dict[str, Any]:
    def numbers(*columns: str) -> list[float]:
        return [_number(row, column) for column in columns]

    place = numbers("x", "y", "z")
    if has_quaternion:
        pose = np.eye(4)
        pose[:3, :3] = rotation(numbers("qw", "qx", "qy", "qz"))
        pose[:3, 3] = place
    else:
        direction = numbers("dx", "dy", "dz")
        roll = _number(row, "roll_deg") if row.get("roll_deg") else 0.0
        if not any(direction):
            raise StudyError(f"the direction of '{row['name']}' is zero")
        pose = look_along(place, direction, math.radians(roll), study.up)
    return {"name": row["name"], "camera_to_world": pose.tolist()}


def _number(row: Mapping[str, str], column: str) -> float:
    try:
        value = float(row[column])
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise StudyError(f"{column} of '{row['name']}' = '{row[column]}' must be a number")
    return value


def _from_colmap(text: str, study: Study) -> Mapping[str, Any]:
    """Return the poses of images; see https://colmap.github.io/format.html."""
    names = {name.replace(" ", "_"): name for name in study.sensor_names}  # as we write them
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    poses = []
    for line in lines[::2]:  # between them are lines of points
        parts = line.split(maxsplit=9)
        if not parts:
            continue
        if len(parts) < 10:
            raise StudyError(f"'{line[:60]}' is no line of COLMAP's images.txt")
        if Path(parts[9]).parent.name == SECOND:  # fixed to the first, it has no pose of its own
            continue
        name = Path(parts[9]).stem
        row = dict(zip(("qw", "qx", "qy", "qz", "x", "y", "z"), parts[1:8], strict=True))
        to_camera = np.array(_row_pose(row | {"name": name}, True, study)["camera_to_world"])
        pose = rigid_inverse(to_camera)
        pose[:3, :3] = pose[:3, :3] @ OPTICAL
        poses.append({"name": names.get(name, name), "camera_to_world": pose.tolist()})
    return {"poses": poses}


_QUATERNION, _DIRECTION = {"qw", "qx", "qy", "qz"}, {"dx", "dy", "dz"}
_READERS: dict[str, Callable[[str, Study], Mapping[str, Any]]] = {
    ".json": _from_json,
    ".csv": _from_table,
    ".txt": _from_colmap,
}

"""Lenses from calibration files: OpenCV's FileStorage, ROS's camera_info and kalibr's chains.

All of them are YAML, OpenCV's XML or JSON as well. Read are the size of the image, the camera
matrix and the distortion; what else a file holds is left alone. Every scalar is read as a text
and becomes a number here, since the three write numbers that YAML 1.1 takes for texts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from lxml import etree

from glvis.common.complaints import as_toml, shortened
from glvis.common.files import DEEPEST, read_text
from glvis.common.values import LARGEST_IMAGE
from glvis.problem.calibrated_lens import FisheyeLens, OpenCVLens
from glvis.problem.expressions import nearest
from glvis.problem.lens import Lens
from glvis.study.lens_table import lens_without_distortion, refuse_blind

_MOST = 1_000_000  # bytes; OpenCV's sample adds the points of all its pictures, some 100 kB
_MOST_VALUES = 50_000  # and these are some 10,000; a second or two
# What the keys are called: OpenCV's samples, ROS and its messages in two generations.
_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "intrinsic_matrix", "K", "k", "M")
_DISTORTION = (
    "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs",
    "distortion", "D", "d",
)  # fmt: skip
_WIDTH, _HEIGHT = ("image_width", "width"), ("image_height", "height")
_SIZE = ("image_Size", "image_size", "imageSize", "resolution", "size")
_OF_TWO = ("", "1")  # of a pair of cameras, the first: M1, D1
# What a distortion is called, and which lens and which numbers of coefficients it means.
_Counts = tuple[int, ...]
_MODELS: dict[str, tuple[str, _Counts]] = {
    "plumb_bob": ("opencv", (0, 4, 5)),
    "rational_polynomial": ("opencv", (0, 8)),
    "radtan": ("opencv", (4,)),
    "equidistant": ("fisheye", (0, 4)),
    "fisheye": ("fisheye", (0, 4)),
    "none": ("opencv", (0,)),
    "": ("opencv", (0,)),
}
_OPENCV_COUNTS: _Counts = (0, 4, 5, 8)
_FISHEYE_COUNTS: _Counts = (0, 4)
_LENSES = {"opencv": OpenCVLens, "fisheye": FisheyeLens}
_YAML_VERSION = re.compile(r"\A\s*%YAML[ :][\d.]+[ \t\r]*\n")  # OpenCV's "%YAML:1.0" is no YAML
_CAMERA = re.compile(r"cam\d+")
_SKEW = 1e-9  # share of the focal length


def read_calibration(
    path: Path, size: tuple[int, int] | None = None, kind: str | None = None
) -> tuple[tuple[int, int], Lens]:
    """Return the size of the image that was calibrated, and its lens.

    Parameters
    ----------
    path : Path
        The file. "chain.yaml#cam1" is the second camera of a chain of kalibr, the first without;
        "pair.yml#2" that of M2 and D2 in OpenCV's file of a pair.
    size : tuple of int, optional
        Pixels (width, height), for a file that has none.
    kind : str, optional
        "opencv" or "fisheye", for a file that does not say its model.

    Raises
    ------
    ValueError
        In one line: file, key, what it got and what is allowed.
    """
    file, camera = _split(path)
    try:
        if kind not in (None, *_LENSES):
            raise ValueError(f"is read with lens = 'opencv' or 'fisheye', not '{kind}'")
        found = _parsed(_text(file))
        is_chain = any(_CAMERA.fullmatch(key) for key in found)
        return (_of_chain if is_chain else _of_one)(found, camera, size, kind)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


def _split(path: Path) -> tuple[Path, str]:
    """Return the file and what stands behind "#", which may be part of the file's name as well."""
    name, mark, camera = path.name.rpartition("#")
    try:
        is_name = not mark or path.exists()
    except OSError as error:  # such as a name that is too long
        raise ValueError(f"{shortened(path.name)}: {error.strerror}") from None
    return (path, "") if is_name else (path.with_name(name or camera), camera)


def _text(path: Path) -> str:
    try:
        return read_text(path, _MOST)
    except FileNotFoundError:
        raise ValueError("does not exist") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"is no text in UTF-8 (byte {error.start})") from None
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from None


class _Loader(yaml.BaseLoader):
    """Reads scalars as texts, tagged or not; no aliases, by which a small file becomes endless."""

    depth = count = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node, unless it is an alias or too deep."""
        if self.check_event(yaml.AliasEvent):
            raise ValueError(f"has an alias, *{self.peek_event().anchor}; write out what it means")
        if self.depth > DEEPEST:
            raise RecursionError
        self.count += 1
        if self.count > _MOST_VALUES:
            raise ValueError(f"is no calibration: it has more than {_MOST_VALUES:,} values")
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def _parsed(text: str) -> dict[str, Any]:
    """Return nested tables and lists of texts."""
    try:
        if text.lstrip().startswith("<"):
            found = _from_xml(text)
        else:
            loader = _Loader(_YAML_VERSION.sub("", text))
            found = loader.get_data() if loader.check_data() else None  # the first, if several
    except (yaml.YAMLError, etree.XMLSyntaxError) as error:
        fact = getattr(error, "problem", None) or str(error).splitlines()[0]
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        raise ValueError(f"is no YAML or XML{where}: {shortened(str(fact))}") from None
    except RecursionError:
        raise ValueError("is no calibration: nested too deeply") from None
    if not isinstance(found, dict) or not found:
        raise ValueError("is no calibration: it has no keys")
    return found


def _from_xml(text: str) -> Any:
    """Return what OpenCV's XML says: elements with others in them as tables, else their text."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    root = etree.fromstring(text.encode(), parser)  # of bytes: it may say its encoding

    def value(element: Any, depth: int = 0) -> Any:
        if depth > DEEPEST:
            raise RecursionError
        inner = [child for child in element if isinstance(child.tag, str)]
        if inner:
            return {child.tag: value(child, depth + 1) for child in inner}
        return (element.text or "").strip().strip('"')

    return value(root)


def _of_chain(
    cameras: Mapping[str, Any], camera: str, size: tuple[int, int] | None, kind: str | None
) -> tuple[tuple[int, int], Lens]:
    """Return size and lens of a camera of kalibr's chain."""
    camera = camera or "cam0"
    if not isinstance(table := cameras.get(camera), dict):
        known = [key for key in cameras if _CAMERA.fullmatch(key)]
        raise ValueError(
            f"has no camera '{shortened(camera)}'; it has {shortened(', '.join(known))}, "
            f"of which 'FILE#{known[0]}' is one"
        )
    try:
        model = table.get("camera_model", "pinhole")
        if model != "pinhole":
            raise ValueError(
                f"camera_model = {as_toml(model)} must be 'pinhole', glvis has no other"
            )
        fx, fy, cx, cy = _numbers(table, "intrinsics", (4,))
        model = _model(table)
        coefficients = _coefficients(table, "distortion_coeffs", _MODELS[model][1])
        size = _size(table) or size
        return _lens(size, (fx, fy), (cx, cy), model, coefficients, kind)
    except ValueError as error:
        raise ValueError(f"{camera}: {error}") from None


def _of_one(
    table: Mapping[str, Any], camera: str, size: tuple[int, int] | None, kind: str | None
) -> tuple[tuple[int, int], Lens]:
    """Return size and lens of a file of OpenCV or ROS."""
    endings = (camera,) if camera else _OF_TWO
    matrix_key = _first(table, _MATRIX, endings)
    if matrix_key is None:
        raise ValueError(
            f"has no camera matrix{f' of camera {shortened(camera)}' if camera else ''}; it may be "
            f"called {', '.join(_MATRIX[:2])}, K or M1, or be kalibr's cam0"
        )
    fx, skew, cx, _, fy, cy, *_ = matrix = _numbers(table, matrix_key, (9,))
    if matrix[3] or matrix[6:] != [0, 0, 1] or abs(skew) > _SKEW * abs(fx):
        raise ValueError(
            f"{matrix_key} = {as_toml(matrix)} must be [fx, 0, cx, 0, fy, cy, 0, 0, 1], row by row"
        )
    model, counts = "", _OPENCV_COUNTS
    if "distortion_model" in table:
        model = _model(table)
        counts = _MODELS[model][1]
    elif kind == "fisheye" or _says_fisheye(table):
        model, counts = "fisheye", _FISHEYE_COUNTS
    ending = matrix_key[-1] if matrix_key[-1].isdigit() else ""
    key = _first(table, _DISTORTION, (ending,))
    if key is None and (model or "distortion_model" not in table):
        raise ValueError(
            f"has no distortion; it may be called {_DISTORTION[0]}{ending}, distCoeffs{ending} or "
            f"D{ending}, and be []"
        )
    coefficients = _coefficients(table, key, counts) if key else []
    return _lens(_size(table) or size, (fx, fy), (cx, cy), model, coefficients, kind)


def _lens(
    size: tuple[int, int] | None,
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    model: str,
    coefficients: Sequence[float],
    kind: str | None,
) -> tuple[tuple[int, int], Lens]:
    """Return size and lens, which is an ideal pinhole where nothing is distorted."""
    if size is None:
        raise ValueError("has no image_width and image_height; give resolution beside calibration")
    told = _MODELS[model][0]
    if model and model != "none" and kind not in (None, told):
        raise ValueError(f"is of lens = '{told}', not '{kind}'")
    if min(focal_px) <= 0:
        raise ValueError(f"has focal lengths {as_toml(list(focal_px))} that must be above 0 pixels")
    if told == "opencv" and kind != "fisheye" and not any(coefficients):
        return size, lens_without_distortion(size, focal_px, centre_px)
    lens = _LENSES[kind or told](size, focal_px, centre_px, tuple(coefficients))
    refuse_blind(lens)
    return size, lens


def _first(table: Mapping[str, Any], names: Sequence[str], endings: Sequence[str]) -> str | None:
    """Return the first key that a file has of several, with one of some endings."""
    return next((n + end for end in endings for n in names if n + end in table), None)


def _says_fisheye(table: Mapping[str, Any]) -> bool:
    """Return whether OpenCV's own calibration sample says that it took the fisheye."""
    return table.get("fisheye_model") in ("1", "true")


def _model(table: Mapping[str, Any]) -> str:
    """Return what a file calls its distortion, one that is known."""
    if "distortion_model" not in table:
        raise ValueError("'distortion_model' is missing")
    model = table["distortion_model"]
    if not isinstance(model, str) or model not in _MODELS:
        hint = nearest(model, _MODELS) if isinstance(model, str) else ""
        known = ", ".join(filter(None, _MODELS))
        raise ValueError(f"distortion_model = {as_toml(model)} is unknown{hint}; known are {known}")
    return model


def _size(table: Mapping[str, Any]) -> tuple[int, int] | None:
    """Return the size of the image, None where a file says none."""
    width, height = _first(table, _WIDTH, ("",)), _first(table, _HEIGHT, ("",))
    if width and height:
        return _pixels(table, width), _pixels(table, height)
    key = _first(table, _SIZE, ("",))
    if not key:
        return None
    first, second = _numbers(table, key, (2,))
    return _whole(key, first), _whole(key, second)


def _pixels(table: Mapping[str, Any], key: str) -> int:
    (number,) = _numbers({key: [table[key]]}, key, (1,))
    return _whole(key, number)


def _whole(key: str, number: float) -> int:
    if not (number.is_integer() and 1 <= number <= LARGEST_IMAGE):
        raise ValueError(f"{key} = {number:g} must be whole pixels from 1 to {LARGEST_IMAGE}")
    return int(number)


def _coefficients(table: Mapping[str, Any], key: str, counts: Sequence[int]) -> list[float]:
    """Return the coefficients of a distortion, [] where there is none."""
    most = max(counts)
    found = [] if key not in table and not most else _numbers(table, key, None)
    if most > 4 and not any(found[most:]):  # OpenCV pads what it did not fit with zeros
        found = found[:most]
    if not any(found):
        return []
    if len(found) not in counts:
        allowed = " or ".join(str(count) for count in counts if count) or "no"
        raise ValueError(f"{key} has {len(found)} numbers, it must have {allowed}")
    return found


def _numbers(table: Mapping[str, Any], key: str, counts: Sequence[int] | None) -> list[float]:
    """Return the numbers of a key: a list, lists in a list, or a matrix of OpenCV's and ROS's."""
    if key not in table:
        raise ValueError(f"'{key}' is missing")
    value = table[key]
    if isinstance(value, dict):  # of rows, cols and data
        if "data" not in value:
            raise ValueError(f"{key}: 'data' is missing")
        value = value["data"]
    if isinstance(value, str):  # of XML
        value = value.split()
    if isinstance(value, list) and all(isinstance(row, list) for row in value):
        value = [entry for row in value for entry in row]
    numbers = [_number(key, entry) for entry in value]
    if counts and len(numbers) not in counts:
        allowed = " or ".join(map(str, counts))
        raise ValueError(f"{key} has {len(numbers)} numbers, it must have {allowed}")
    return numbers


def _number(key: str, entry: Any) -> float:
    try:
        number = float(entry)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{key} has {as_toml(entry)}, it must be numbers")
    return number

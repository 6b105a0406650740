"""Coloured surfaces for other tools: PLY a model, and one glTF file of the whole scene."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.common.palette import OBSTACLE_COLOR, second_tones, sensor_colors
from glvis.pictures.coloring import Seen, coloring
from glvis.problem.field import Field, field_of, partner_field
from glvis.problem.lens import Lens, Pinhole
from glvis.problem.rotations import quaternion, rotation_between
from glvis.problem.scene import Model
from glvis.problem.sensor import Sensor
from glvis.problem.units import MM_PER_UNIT
from glvis.results.calibrations import partner_size
from glvis.results.export_poses import PIECES, surface_names
from glvis.search.placement import Placement
from glvis.visibility.folding import fold, folded

Colors = NDArray[np.uint8]
Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_ARRAY, _INDICES = 34962, 34963  # OpenGL's names of buffers
_FLOAT, _UINT = 5126, 5125
_LINES = 1
# Corners 0 to 3 near, 4 to 7 far, 8 the optical centre: the edges of a frustum.
_EDGES = [(i, (i + 1) % 4) for i in range(4)] + [(4 + i, 4 + (i + 1) % 4) for i in range(4)]
_EDGES += [(i, 4 + i) for i in range(4)] + [(8, i) for i in range(4)]


def face_colors(placement: Placement, m: int) -> Colors:
    """Return the colour of each face of model ``m``, (F, 3): the sensor that sees it best."""
    study = placement.study
    seen = Seen(
        study.models[m],
        placement.maps[m],
        study.sensors,
        placement.camera_to_world,
        study.unit,
        study.visibility.incidence == "axis",
    )
    return coloring("sensor", seen).colors[:, :3]


def write_surfaces(placement: Placement, directory: Path) -> None:
    """Write a coloured PLY for each model and obstacle, and ``scene.glb``.

    Of a model whose faces were cut, one of the file's own faces and, in a folder of its own, one
    of the pieces, which is also what the scene shows.
    """
    study = placement.study
    names, n_models = surface_names(study), len(study.models)
    colors = [face_colors(placement, m) for m in range(n_models)]
    for m, (model, found) in enumerate(zip(study.models, placement.maps, strict=True)):
        file, counts = f"{names[m]}.ply", found.counts
        if model.pieces is None:
            write_ply(directory / file, model, colors[m], {"seen_by": counts})
            continue
        (directory / PIECES).mkdir(exist_ok=True)
        of_pieces: dict[str, NDArray[Any]] = {"seen_by": counts, "piece_of": model.pieces.file_face}
        write_ply(directory / PIECES / file, model, colors[m], of_pieces)
        share, is_seen = fold(counts > 0, model)
        of_faces: dict[str, NDArray[Any]] = {
            "seen_by": folded(found, model).counts,
            "seen_share": share,
        }
        most = _of_most_area(model, colors[m], counts > 0, is_seen)
        write_ply(directory / file, model.file, most, of_faces)
    for name, obstacle in zip(names[n_models:], study.obstacles, strict=True):
        colors.append(np.tile(OBSTACLE_COLOR, (obstacle.n_faces, 1)))
        unseen = np.zeros(obstacle.n_faces, dtype=np.int64)
        write_ply(directory / f"{name}.ply", obstacle, colors[-1], {"seen_by": unseen})
    write_glb(directory / "scene.glb", placement, colors)


def _of_most_area(model: Model, colors: Colors, seen: Bools, is_seen: Bools) -> Colors:
    """Return colours (F_file, 3) of the file's faces from those of their pieces.

    That of the most area of what is seen; of those that are not, that of what is not.
    """
    assert model.pieces
    unique, which = np.unique(colors, axis=0, return_inverse=True)
    owner, n = model.pieces.file_face.astype(np.int64), len(unique)
    counted = np.where(seen == is_seen[owner], model.areas, 0.0)
    shape = model.file.n_faces, n
    area = np.bincount(owner * n + which.reshape(-1), counted, minlength=shape[0] * n)
    return np.asarray(unique[area.reshape(shape).argmax(axis=1)])


def write_ply(path: Path, mesh: Model, colors: Colors, told: Mapping[str, NDArray[Any]]) -> None:
    """Write a mesh as binary PLY with a colour a face.

    Each face has three vertices of its own that carry its colour, as most viewers read colours
    of vertices only.

    Parameters
    ----------
    path : Path
        The file.
    mesh : Model
        F faces, kept in their order.
    colors : (F, 3) uint8
        sRGB.
    told : dict of str to (F,) int or float
        Properties of each face: "seen_by", the number of sensors that see it; "seen_share", the
        share of its area that any sees; "piece_of", the face of the file that it is a piece of.
    """
    n = mesh.n_faces
    vertices = np.zeros((n, 3), dtype=[("place", "<f4", 3), ("color", "u1", 3)])
    vertices["place"] = mesh.vertices[mesh.faces]
    vertices["color"] = colors[:, None]
    kinds = {name: "int" if array.dtype.kind in "iu" else "float" for name, array in told.items()}
    columns: list[Any] = [("n", "u1"), ("vertices", "<i4", 3), ("color", "u1", 3)]
    columns += [(name, "<i4" if kind == "int" else "<f4") for name, kind in kinds.items()]
    faces = np.zeros(n, columns)
    faces["n"] = 3
    faces["vertices"] = np.arange(3 * n).reshape(n, 3)
    faces["color"] = colors
    for name, array in told.items():
        faces[name] = array
    properties = "".join(f"property {kind} {name}\n" for name, kind in kinds.items())
    channels = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment glvis: {mesh.name}\n"
        f"element vertex {3 * n}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"{channels}"
        f"element face {n}\nproperty list uchar int vertex_indices\n{channels}"
        f"{properties}end_header\n"
    )
    path.write_bytes(header.encode("ascii", "replace") + vertices.tobytes() + faces.tobytes())


def write_glb(path: Path, placement: Placement, colors: list[Colors]) -> None:
    """Write the scene as binary glTF 2.0: metres, +Y up, one glTF scene a model.

    Parameters
    ----------
    path : Path
        The file.
    placement : Placement
        Models, obstacles, sensors, poses.
    colors : list of (F, 3) uint8
        Of the faces of models and then obstacles, sRGB.
    """
    study = placement.study
    writer = _Gltf(MM_PER_UNIT[study.unit] / 1000, rotation_between(study.up, [0, 1, 0]))
    meshes = [*study.models, *study.obstacles]
    surfaces = [
        writer.add_surface(name, mesh, color)
        for name, mesh, color in zip(surface_names(study), meshes, colors, strict=True)
    ]
    tints = sensor_colors(len(study.sensors))
    sensors = [
        writer.add_sensor(name, sensor, pose, tint)
        for name, sensor, pose, tint in zip(
            study.sensor_names, study.sensors, placement.camera_to_world, tints, strict=True
        )
    ]
    n_models = len(study.models)
    for model, surface in zip(study.models, surfaces[:n_models], strict=True):
        nodes = [surface, *surfaces[n_models:], *sensors]
        writer.content["scenes"].append({"name": model.name, "nodes": nodes})
    path.write_bytes(writer.packed())


def _field_lines(field: Field, near: float, far: float) -> tuple[Floats, NDArray[np.int64]]:
    """Return points (N, 3) of a field's lines, camera frame, and the edges (M, 2) between them."""
    if field.is_flat and len(field.rays) == 4 and len(field.borders[0]) == 5:
        local = [field.at(field.rays, reach) for reach in (near, far)]
        return np.concatenate([*local, field.centre[None]]), np.array(_EDGES)
    points, edges, n = [field.centre[None]], [], 1
    for reach in (near, far):
        for line in (*field.borders, *field.ribs):
            points.append(field.at(line, reach))
            first = n + np.arange(len(line) - 1)
            edges.append(np.stack([first, first + 1], axis=1))
            n += len(line)
    k = len(field.rays)
    points += [field.at(field.rays, reach) for reach in (near, far)]
    edges.append(np.stack([np.zeros(k, dtype=np.int64), n + np.arange(k)], axis=1))
    edges.append(n + np.stack([np.arange(k), k + np.arange(k)], axis=1))
    return np.concatenate(points), np.concatenate(edges)


class _Gltf:
    """A glTF file as it grows: the JSON, and the bytes that it points into."""

    def __init__(self, scale: float, rotation: Floats) -> None:
        self._scale, self._rotation = scale, rotation  # from the study's world to glTF's
        self._bytes = bytearray()
        self._materials: dict[tuple[bytes, bool], int] = {}
        self.content: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "glvis"},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
        }
        for name in ("scenes", "nodes", "meshes", "cameras", "materials", "accessors"):
            self.content[name] = []
        self.content["bufferViews"] = []

    def add_surface(self, name: str, mesh: Model, colors: Colors) -> int:
        """Add a mesh, its faces grouped by colour; return its node."""
        centre = mesh.bounds.mean(axis=0)  # single precision is relative to it
        local = self._scale * (mesh.vertices - centre) @ self._rotation.T
        position = self._accessor(local.astype(np.float32), "VEC3", _ARRAY)
        order = colors.astype(np.int64) @ [1 << 16, 1 << 8, 1]
        primitives = [
            {
                "attributes": {"POSITION": position},
                "indices": self._accessor(
                    mesh.faces[order == key].astype(np.uint32).ravel(), "SCALAR", _INDICES
                ),
                "material": self._material(colors[np.argmax(order == key)], is_line=False),
            }
            for key in np.unique(order)
        ]
        self.content["meshes"].append({"name": name, "primitives": primitives})
        place = self._scale * self._rotation @ centre
        node = {"mesh": len(self.content["meshes"]) - 1, "translation": place.tolist()}
        return self._node(name, node)

    def add_sensor(self, name: str, sensor: Sensor, pose: Floats, color: Colors) -> int:
        """Add a camera with its field of view as lines, and its second viewpoint; return its node.

        A camera of glTF is a pinhole: it holds the image, drawn without distortion.
        """
        children = [self._field(f"{name} frustum", sensor, field_of(sensor), color)]
        if (partner := sensor.partner) and (second := partner_field(sensor)):
            tone, full = second_tones(color), f"{name} {partner.role}"
            camera = self._camera(full, sensor, partner.lens, partner_size(sensor))
            place = self._scale * partner.partner_to_sensor[:3, 3]
            # the lines are in the frame of the first
            children.append(self._field(f"{full} frustum", sensor, second, tone))
            children.append(self._camera_node(full, camera, partner.partner_to_sensor, place, []))
        camera = self._camera(name, sensor, sensor.lens, sensor.resolution)
        place = self._scale * self._rotation @ pose[:3, 3]
        return self._camera_node(name, camera, self._rotation @ pose[:3, :3], place, children)

    def _camera(self, name: str, sensor: Sensor, lens: Lens, resolution: tuple[int, int]) -> int:
        """Add the camera of a lens; return its number."""
        tan_x, tan_y = lens.tan_half.tolist()
        is_pinhole = isinstance(lens, Pinhole)
        self.content["cameras"].append(
            {
                "name": name,
                "type": "perspective",
                "perspective": {
                    "yfov": lens.opening[1] if is_pinhole else 2 * math.atan(tan_y),
                    "aspectRatio": tan_x / tan_y,
                    "znear": self._scale * sensor.max_distance / 1000,
                    "zfar": self._scale * sensor.max_distance,
                },
                "extras": {
                    "sensor": sensor.name,
                    "resolution": list(resolution),
                    "min_distance": self._scale * sensor.min_distance,
                    "max_distance": self._scale * sensor.max_distance,
                    **({} if sensor.distance == "depth" else {"distance": sensor.distance}),
                    **({} if is_pinhole else {"lens": lens.kind, "drawn": "without distortion"}),
                },
            }
        )
        return len(self.content["cameras"]) - 1

    def _camera_node(
        self, name: str, camera: int, rotation: Floats, place: Floats, children: list[int]
    ) -> int:
        w, x, y, z = quaternion(rotation[:3, :3]).tolist()
        node = {"camera": camera, "rotation": [x, y, z, w], "translation": place.tolist()}
        return self._node(name, node | ({"children": children} if children else {}))

    def _field(self, name: str, sensor: Sensor, field: Field, color: Colors) -> int:
        """Add the edges of a field of view over the working range as lines; return their node."""
        points, edges = _field_lines(field, sensor.min_distance, sensor.max_distance)
        primitive = {
            "attributes": {
                "POSITION": self._accessor(
                    (self._scale * points).astype(np.float32), "VEC3", _ARRAY
                )
            },
            "indices": self._accessor(edges.astype(np.uint32).ravel(), "SCALAR", _INDICES),
            "material": self._material(color, is_line=True),
            "mode": _LINES,
        }
        self.content["meshes"].append({"name": name, "primitives": [primitive]})
        return self._node(name, {"mesh": len(self.content["meshes"]) - 1})

    def packed(self) -> bytes:
        """Return the file."""
        if not self.content["cameras"]:
            del self.content["cameras"]
        self.content["buffers"] = [{"byteLength": len(self._bytes)}]
        text = json.dumps(self.content, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        data = bytes(self._bytes)
        chunks = [(b"JSON", text), (b"BIN\0", data)]
        total = 12 + sum(8 + len(part) for _, part in chunks)
        head = b"glTF" + np.array([2, total], dtype="<u4").tobytes()
        return head + b"".join(
            np.array([len(part)], dtype="<u4").tobytes() + kind + part for kind, part in chunks
        )

    def _node(self, name: str, node: dict[str, Any]) -> int:
        self.content["nodes"].append({"name": name} | node)
        return len(self.content["nodes"]) - 1

    def _accessor(self, array: NDArray[Any], kind: str, target: int) -> int:
        view = {
            "buffer": 0,
            "byteOffset": len(self._bytes),
            "byteLength": array.nbytes,
            "target": target,
        }
        self._bytes += array.astype(array.dtype.newbyteorder("<")).tobytes()
        self.content["bufferViews"].append(view)
        accessor: dict[str, Any] = {
            "bufferView": len(self.content["bufferViews"]) - 1,
            "componentType": _FLOAT if array.dtype == np.float32 else _UINT,
            "count": len(array),
            "type": kind,
        }
        if target == _ARRAY:
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.content["accessors"].append(accessor)
        return len(self.content["accessors"]) - 1

    def _material(self, color: Colors, *, is_line: bool) -> int:
        key = (bytes(color), is_line)
        if key not in self._materials:
            value = np.asarray(color, dtype=float) / 255
            # glTF's factors are linear light, colours are sRGB (IEC 61966-2-1)
            linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
            material: dict[str, Any] = {
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*linear.tolist(), 1.0],
                    "metallicFactor": 0.0,
                    "roughnessFactor": 0.9,
                },
                "doubleSided": not is_line,
            }
            if is_line:
                material["extensions"] = {"KHR_materials_unlit": {}}
            self._materials[key] = len(self.content["materials"])
            self.content["materials"].append(material)
        return self._materials[key]

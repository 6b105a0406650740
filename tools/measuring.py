"""Scenes to time, ways to time them, and the rival: what bench and gpu_check.py share."""

from __future__ import annotations

import functools
import math
import os
import platform
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[1]
SHARED = HERE.parent / "shared" / "data"

# Table 8 of the paper: position in mm, direction, roll in degrees.
TABLE_8 = {
    "A1": ((178, -242, 136), (-0.82, 0.55, -0.14), 0),
    "B1": ((291, 73, 136), (-0.57, -0.40, -0.72), 0),
    "C1": ((-178, -242, 136), (0.82, 0.55, -0.14), 0),
    "D1": ((-291, 73, 136), (0.57, -0.40, -0.72), 0),
    "A2": ((216, -208, -136), (-0.77, 0.62, -0.13), 20),
    "B2": ((236, 185, -136), (-0.66, -0.74, -0.12), 0),
    "C2": ((-216, -208, -136), (0.77, 0.62, -0.13), -20),
    "D2": ((-236, 185, -136), (0.66, -0.74, -0.12), 0),
}


# Where the time of maps goes: module, class or "", what is called, and the step that it is. Who is
# not there any more has no row.
_CAST, _DRAW, _MAPS = (f"glvis.visibility.{name}" for name in ("cast", "draw", "maps"))
_STEPS: tuple[tuple[str, str, str, str], ...] = (
    (_MAPS, "", "cull", "culling, NumPy"),
    (_CAST, "Caster", "answer", "lists and marking, NumPy"),
    (_CAST, "Caster", "_bind", "upload"),
    (_CAST, "Caster", "_run", "GPU: {1}"),  # by the name of the pass
    (_CAST, "Caster", "_hide", "GPU: hide"),
    (_CAST, "Caster", "_found", "read-back"),
    (_DRAW, "Drawer", "visible", "GPU: draw"),
    ("glvis.visibility.renderer", "Renderer", "_read_ids", "read-back"),
    (_DRAW, "", "pixels_of_faces", "marking, NumPy"),
    ("glvis.visibility.coincident", "Coincident", "pixels_shared", "marking, NumPy"),
    ("glvis.visibility.rays", "", "visible", "points, NumPy"),
)


# --- scenes


def arm_study(criterion: str, resolution: str = '"auto"'):
    """Return the study of Table 8's eight D415 before six arms, without the holder."""
    from glvis import load_study

    arms = SHARED / "arms" if (SHARED / "arms").is_dir() else HERE / "scenes"
    mounts = "".join(
        f'[[mount]]\nname = "{name}"\nsensor = "d415-buonamici"\nposition = {list(place)}\n'
        f"direction = {list(direction)}\nroll_deg = {roll}\n"
        for name, (place, direction, roll) in TABLE_8.items()
    )
    text = (
        f'unit = "mm"\nup = [0, 1, 0]\n[scene]\nmodels = ["{arms}/arm?.stl"]\nmax_edge = "off"\n'
        f'[visibility]\ncriterion = "{criterion}"\nresolution = {resolution}\n{mounts}'
    )
    path = scratch() / f"arms-{criterion}.toml"
    path.write_text(text)
    return load_study(path)


def maker_of(model, sensor, options):
    """Return a function from poses (N, 4, 4) to the maps of a model, (N, F) bool."""
    from glvis.visibility.maps import LocalMaps, MapJob, MapScene

    maps = LocalMaps(MapScene((model,), (), (sensor,), options))

    def visible(poses):
        (bits,) = maps.make([MapJob(0, poses)])
        return np.unpackbits(bits, axis=1, count=model.n_faces).view(bool)

    return visible


def dented_ball(n_faces: int):
    """Return a closed mesh of about ``n_faces`` even faces, dented so that it hides parts."""
    from glvis.problem.scene import Model

    n = max(2, round(math.sqrt(n_faces / 12)))
    u = np.tan(np.linspace(-math.pi / 4, math.pi / 4, n + 1))
    a, b = np.meshgrid(u, u, indexing="ij")
    one = np.ones_like(a)
    sides = [(a, b, one), (b, a, -one), (b, one, a), (a, -one, b), (one, a, b), (-one, b, a)]
    points = np.stack([np.stack(side, axis=-1) for side in sides]).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    x, y, z = points.T
    radius = 60 * (1 + 0.25 * np.sin(5 * x + 1) * np.sin(4 * y + 2) * np.sin(6 * z) + 0.1 * x * y)
    points = np.round(points * radius[:, None], 6).astype(np.float32)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    corner = (i * (n + 1) + j).ravel()
    quad = np.stack([corner, corner + n + 1, corner + n + 2, corner + 1], axis=1)
    quads = np.concatenate([quad + side * (n + 1) ** 2 for side in range(6)])
    faces = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return Model.from_arrays(f"ball-{n_faces}", points, faces)


def ball_views(n: int):
    """Return n poses around a ball that see it whole, and the sensor."""
    from glvis.problem.camera import look_along
    from glvis.problem.lens import Pinhole
    from glvis.problem.sensor import Sensor

    k = np.arange(n) + 0.5
    z, turn = 1 - 2 * k / n, math.pi * (1 + math.sqrt(5)) * k
    around = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)
    device = Sensor(
        "bench", Pinhole.from_degrees(66.4, 39.5), (1280, 720), 100, 400, math.radians(70)
    )
    return look_along(260 * around, -around), device


def scratch() -> Path:
    """Return a folder for studies and meshes of this run."""
    import tempfile

    folder = Path(tempfile.gettempdir()) / f"glvis-bench-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    return folder


# --- the rival


class Embree:
    """Visibility maps by embreex: NumPy filters, then rays, on one thread."""

    def __init__(self, model) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        start = time.perf_counter()
        self.model = model
        self.scene = rtcore_scene.EmbreeScene()
        TriangleMesh(self.scene, model.vertices[model.faces].astype(np.float32))
        self._first(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))  # builds its tree
        self.build_seconds = time.perf_counter() - start

    def _first(self, origins, directions):
        return self.scene.run(origins.astype(np.float32), directions.astype(np.float32))

    def _filtered(self, points, normals, pose, sensor):
        ray = points - pose[:3, 3]
        x, y, z = (ray @ pose[:3, :3]).T
        tan_x, tan_y = sensor.lens.tan_half
        length = np.linalg.norm(ray, axis=1)
        cosine = -np.einsum("ij,ij->i", ray, normals) / length
        kept = (-z >= sensor.min_distance) & (-z <= sensor.max_distance)
        kept &= (np.abs(x) <= -z * tan_x) & (np.abs(y) <= -z * tan_y)
        return np.flatnonzero(kept & (cosine >= math.cos(sensor.max_incidence))), ray, length

    def centroids(self, pose, sensor):
        """Return the map (F,) by one ray to each centre of mass."""
        model = self.model
        kept, ray, _ = self._filtered(model.centroids, model.normals, pose, sensor)
        visible = np.zeros(model.n_faces, dtype=bool)
        if len(kept):
            origin = np.broadcast_to(pose[:3, 3], (len(kept), 3))
            visible[kept] = self._first(origin, ray[kept]) == kept
        return visible

    def sweep(self, pose, sensor, resolution):
        """Return the map (F,) by one ray through each pixel."""
        width, height = resolution
        tan_x, tan_y = sensor.lens.tan_half
        x = (2 * (np.arange(width) + 0.5) / width - 1) * tan_x
        y = (1 - 2 * (np.arange(height) + 0.5) / height) * tan_y
        grid = np.stack(np.broadcast_arrays(x[None], y[:, None], -1.0), axis=-1).reshape(-1, 3)
        rays = grid @ pose[:3, :3].T
        hit = self._first(np.broadcast_to(pose[:3, 3], rays.shape), rays)
        struck = np.flatnonzero(hit >= 0)
        face = hit[struck]
        normal = self.model.normals[face]
        ray = rays[struck]
        towards = -np.einsum("ij,ij->i", ray, normal)
        to_plane = self.model.centroids[face] - pose[:3, 3]
        depth = -np.einsum("ij,ij->i", to_plane, normal) / np.where(towards == 0, 1, towards)
        cosine = towards / np.linalg.norm(ray, axis=1)
        kept = cosine >= math.cos(sensor.max_incidence)
        kept &= (depth >= sensor.min_distance) & (depth <= sensor.max_distance)
        visible = np.zeros(self.model.n_faces, dtype=bool)
        visible[face[kept]] = True
        return visible

    def share(self, pose, sensor, n=8):
        """Return the share (F,) of n * n points of each face that the sensor sees."""
        model = self.model
        corners = model.vertices[model.faces]
        seen = np.zeros(model.n_faces)
        steps = [(i, j, 1) for i in range(n) for j in range(n - i)]
        steps += [(i, j, 2) for i in range(n) for j in range(n - 1 - i)]
        for i, j, part in steps:
            a, b = (i + part / 3) / n, (j + part / 3) / n
            points = corners[:, 0] * (1 - a - b) + corners[:, 1] * a + corners[:, 2] * b
            kept, ray, length = self._filtered(points, model.normals, pose, sensor)
            origin = np.broadcast_to(pose[:3, 3], (len(kept), 3)).astype(np.float32)
            unit = (ray[kept] / length[kept, None]).astype(np.float32)
            found = self.scene.run(origin, unit, output=True)
            # the face itself, or whatever is met at the same place
            at_point = np.abs(found["tfar"] - length[kept]) <= 1e-4 * length[kept]
            seen[kept[(found["primID"] == kept) | at_point]] += 1
        return seen / len(steps)


# --- measuring


def taking_turns(ways: dict, repeats: int) -> dict[str, list[float]]:
    """Return seconds of each way by repeat; the first round warms up and is dropped."""
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(repeats + 1):
        for name, way in ways.items():
            start = time.perf_counter()
            way()
            seconds[name].append(time.perf_counter() - start)
    return {name: values[1:] for name, values in seconds.items()}


def against(seconds: dict[str, list[float]], rival: str) -> list[dict]:
    """Return one row a way: median milliseconds, and the median ratio to the rival's turn."""
    base = np.array(seconds[rival])
    return [
        {
            "way": name,
            "ms": 1e3 * float(np.median(values)),
            "best_ms": 1e3 * min(values),
            "ratio": float(np.median(np.array(values) / base)),
        }
        for name, values in seconds.items()
    ]


class Profile:
    """Where time goes between entering and leaving: seconds a step, in the order they are met.

    Each step begins and ends by waiting for the GPU, so that its work counts where it was asked
    for. Waiting costs time of its own: all in all this takes longer than without. What a step asks
    another step for counts there alone.

    Attributes
    ----------
    seconds : dict
        By step; the last one, ``REST``, is what belongs to none.
    """

    REST = "all else"

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._within: list[float] = []  # of each step under way: what others took of its time
        self._kept: list[tuple[Any, str, Any]] = []
        self._start = 0.0

    def __enter__(self) -> Profile:
        for module, owner, name, step in _STEPS:
            place: Any = import_module(module)
            place = getattr(place, owner, None) if owner else place
            work = vars(place).get(name) if place else None
            if callable(work):
                self._kept.append((place, name, work))
                setattr(place, name, self._timed(step, work))
        self._start = time.perf_counter()
        return self

    def __exit__(self, *exception: object) -> None:
        whole = time.perf_counter() - self._start
        for place, name, work in self._kept:
            setattr(place, name, work)
        self._kept.clear()
        self.seconds[self.REST] = max(0.0, whole - sum(self.seconds.values()))

    def _timed(self, step: str, work: Callable[..., Any]) -> Callable[..., Any]:
        from glvis.visibility.context import gl_context

        @functools.wraps(work)
        def wrapped(*arguments: Any, **options: Any) -> Any:
            gl_context().finish()
            start = time.perf_counter()
            self._within.append(0.0)
            try:
                return work(*arguments, **options)
            finally:
                gl_context().finish()
                took = time.perf_counter() - start
                name = step.format(*map(_word, arguments), "", "")
                others = self._within.pop()
                self.seconds[name] = self.seconds.get(name, 0.0) + took - others
                if self._within:
                    self._within[-1] += took

        return wrapped


def _word(argument: Any) -> str:
    return argument if isinstance(argument, str) else ""


def agreement(ours, theirs) -> float:
    """Return the intersection over the union of two sets of maps."""
    union = np.count_nonzero(ours | theirs)
    return float(np.count_nonzero(ours & theirs) / union) if union else 1.0


def device() -> dict:
    """Say what this ran on."""
    from glvis.visibility.context import gl_info

    info, about = gl_info(), Path("/proc/cpuinfo")
    cpu = next(
        (
            line.split(":")[1].strip()
            for line in (about.read_text().splitlines() if about.is_file() else [])
            if line.startswith("model name")
        ),
        platform.machine(),
    )
    return {"gl": f"{info.renderer}, {info.version}", "cpu": f"{cpu}, {os.cpu_count()} cores"}

"""``[sensor.NAME]`` of a study file: the sensor that it means, and the table that says a sensor.

A sensor is described by its keys, by an entry of the catalogue (``from``) or by a calibration
file, the last two with keys beside them. What they say becomes keys first: there is one reading.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from glvis.common.complaints import shortened
from glvis.common.values import (
    FARTHEST,
    FilePath,
    Incidence,
    Kind,
    Place,
    Point,
    Positive,
    between,
    within,
)
from glvis.problem.calibrated_lens import CalibratedLens
from glvis.problem.catalogue import complaint, entries
from glvis.problem.lens import Lens, SphericalLens
from glvis.problem.sensor import Focus, Noise, Partner, Sensor
from glvis.study.calibration_files import read_calibration
from glvis.study.lens_table import LENS_KEYS, LensTable, degrees_of, lens_keys, lens_of
from glvis.study.table import Table

_MOST_POWERS = 16  # of a polynomial of depth; data sheets have two or three
_BESIDE_CALIBRATION = ("lens", "max_angle_deg")  # what a file may leave open


class NoiseTable(Table):
    """``noise = { subpixel }`` or ``{ polynomial, by_incidence }``."""

    subpixel: Positive | None = None
    polynomial: Annotated[
        list[Place],
        within(f"have at most {_MOST_POWERS} numbers", lambda v: len(v) <= _MOST_POWERS),
    ] = []
    by_incidence: bool = False

    def to_noise(self) -> Noise:
        """Return the same as the type that sensors know."""
        if (self.subpixel is None) == (not self.polynomial):
            raise ValueError("needs either 'subpixel' or 'polynomial'")
        return Noise(self.subpixel, tuple(self.polynomial), self.by_incidence)


class FocusTable(Table):
    """``focus = { focal_length, f_number, distance, pixel_pitch }``."""

    focal_length: Positive
    f_number: Positive
    distance: Positive
    pixel_pitch: Positive

    def to_focus(self) -> Focus:
        """Return the same as the type that sensors know."""
        return Focus(self.focal_length, self.f_number, self.distance, self.pixel_pitch)


class PartnerTable(LensTable):
    """``partner = { offset, turn_deg, role }``, and the keys of a lens where it has its own."""

    offset: Point
    turn_deg: Annotated[
        list[Annotated[float, between(-180, 180)]],
        within("be [yaw, pitch]", lambda v: len(v) == 2),
    ] = [0.0, 0.0]
    role: Literal["imager", "projector"] = "imager"

    def to_partner(self, sensor: Sensor) -> Partner:
        """Return the partner of a sensor, with its lens where the table says none."""
        lens = sensor.lens
        if self.has_lens:
            lens = self.to_lens(_size(self.resolution or sensor.resolution))
        elif self.resolution:
            raise ValueError("resolution: goes with the keys of a lens of the partner's own")
        yaw, pitch = map(math.radians, self.turn_deg)
        x, y, z = self.offset
        return Partner((x, y, z), lens, (yaw, pitch), self.role)


class SensorTable(LensTable):
    """``[sensor.NAME]``."""

    from_: Kind | None = Field(None, alias="from")
    calibration: FilePath | None = None
    min_distance: Annotated[float, within("be at least 0", lambda v: v >= 0)] = 0.0
    max_distance: Positive | None = None
    max_incidence_deg: Incidence = 90.0
    distance: Literal["depth", "range"] | None = None  # by the lens
    partner: PartnerTable | None = None
    noise: NoiseTable | None = None
    focus: FocusTable | None = None
    emits: Kind = ""
    cost: Annotated[float, between(0, FARTHEST)] | None = None

    @property
    def is_of_elsewhere(self) -> bool:
        """Whether a part of it stands elsewhere: in the catalogue or in a calibration file."""
        return self.from_ is not None or self.calibration is not None

    def to_sensor(self, name: str, unit: str = "mm", folder: Path | None = None) -> Sensor:
        """Return the sensor of this table.

        Parameters
        ----------
        name : str
            As the study calls it.
        unit : str
            Of the study; the catalogue's lengths become those.
        folder : Path, optional
            Of the study file, which a calibration is looked for beside.

        Raises
        ------
        ValueError
            Of keys that do not go together, or are missing; of the catalogue or the file.
        """
        table = self
        if table.calibration is not None:
            table = table._with_calibration(folder or Path())
        if table.from_ is not None:
            table = table._with_entry(unit, has_lens=self.calibration is None)
        return table._described(name)

    def _with_calibration(self, folder: Path) -> SensorTable:
        """Return the same table with the lens of its calibration file as keys."""
        given = self._dumped()
        for key in LENS_KEYS:
            if key in given and key not in _BESIDE_CALIBRATION:
                raise ValueError(f"{key}: goes without calibration, whose file has the lens")
        size = _size(self.resolution) if self.resolution else None
        with _located("calibration: "):
            found, lens = read_calibration(
                folder / given.pop("calibration"), size, given.pop("lens", None)
            )
        size = size or found
        return SensorTable.model_validate(
            lens_keys(lens, size) | {"resolution": list(size)} | given
        )

    def _with_entry(self, unit: str, has_lens: bool) -> SensorTable:
        """Return the same table with what its entry of the catalogue has and it has not."""
        given = self._dumped()
        name = given.pop("from")
        entry = entries().get(name)
        if entry is None:
            raise ValueError(f"from = '{shortened(name)}' {complaint(name)}")
        if lack := entry.lack_beside(given):
            raise ValueError(f"from = '{name}' {lack} beside it")
        table = entry.table_in(unit)
        lens, own = lens_of(table), {key for key in LENS_KEYS if key in given}
        keys = lens_keys(
            lens,
            _size(given.get("resolution") or table["resolution"]),
            as_angles=not own.isdisjoint({"hfov_deg", "vfov_deg"}),
        )
        table = {key: value for key, value in table.items() if key not in LENS_KEYS}
        # a key of the entry's own lens changes that lens; any other one begins a new lens
        is_same_kind = given.get("lens", lens.kind) == keys.get("lens", "pinhole")
        if has_lens and is_same_kind and own <= {*keys, "lens", "max_angle_deg"}:
            table |= keys
        return SensorTable.model_validate(table | given)

    def _dumped(self) -> dict[str, Any]:
        """Return what the file says, with its tables as plain ones."""
        return self.model_dump(by_alias=True, exclude_unset=True)

    def _described(self, name: str) -> Sensor:
        """Return the sensor that the keys alone describe."""
        if self.resolution is None:
            raise ValueError("'resolution' is missing")
        size = _size(self.resolution)
        lens = self.to_lens(size)
        if self.max_distance is None:
            raise ValueError("'max_distance' is missing")
        sensor = Sensor(
            name,
            lens,
            size,
            self.min_distance,
            self.max_distance,
            math.radians(self.max_incidence_deg),
            self.distance or _usual_distance(lens),
            emits=self.emits,
            cost=self.cost,
        )
        partner = noise = focus = None
        if self.partner:
            with _located("partner: "):
                partner = self.partner.to_partner(sensor)
        if self.noise:
            with _located("noise: "):
                noise = self.noise.to_noise()
                if noise.subpixel and not (partner and partner.baseline):
                    raise ValueError("subpixel needs a partner, whose offset is its baseline")
        if self.focus:
            with _located("focus: "):
                focus = self.focus.to_focus()
        return replace(sensor, partner=partner, noise=noise, focus=focus)


def sensor_table(sensor: Sensor) -> dict[str, Any]:
    """Return a sensor as a study file writes it, the inverse of ``SensorTable.to_sensor``.

    All in numbers: nothing of it stands in the catalogue or in a file.
    """
    size = sensor.resolution
    table = lens_keys(sensor.lens, size) | {
        "resolution": list(size),
        "min_distance": float(sensor.min_distance),
        "max_distance": float(sensor.max_distance),
        "max_incidence_deg": degrees_of(sensor.max_incidence),
    }
    if sensor.distance != _usual_distance(sensor.lens):
        table["distance"] = sensor.distance
    if sensor.partner:
        table["partner"] = _partner_table(sensor.partner, sensor)
    if sensor.noise:
        table["noise"] = _noise_table(sensor.noise)
    if sensor.focus:
        table["focus"] = asdict(sensor.focus)
    if sensor.emits:
        table["emits"] = sensor.emits
    if sensor.cost is not None:
        table["cost"] = float(sensor.cost)
    return table


def _partner_table(partner: Partner, sensor: Sensor) -> dict[str, Any]:
    table: dict[str, Any] = {"offset": list(map(float, partner.offset))}
    if any(partner.turn):
        table["turn_deg"] = [degrees_of(angle) for angle in partner.turn]
    if partner.role != "imager":
        table["role"] = partner.role
    if partner.lens != sensor.lens:
        lens = partner.lens
        size = lens.size if isinstance(lens, CalibratedLens) else sensor.resolution
        table |= lens_keys(lens, size)
        if size != sensor.resolution:
            table["resolution"] = list(size)
    return table


def _noise_table(noise: Noise) -> dict[str, Any]:
    table: dict[str, Any] = {"polynomial": list(map(float, noise.polynomial))}
    if noise.subpixel is not None:
        table = {"subpixel": float(noise.subpixel)}
    return table | ({"by_incidence": True} if noise.by_incidence else {})


def _usual_distance(lens: Lens) -> str:
    """Return what a working range measures where a table does not say."""
    return "range" if isinstance(lens, SphericalLens) else "depth"


def _size(resolution: Sequence[int]) -> tuple[int, int]:
    return resolution[0], resolution[1]


@contextmanager
def _located(where: str) -> Iterator[None]:
    """Put a place before the bare fact of an error."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}{error}") from None

"""The study file's format as pydantic models: types, ranges of single values, names of keys.

Tables become the types of the other modules; nothing here reads a file. A failed check names
the key, what it got and what is allowed, in one line.
"""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, get_type_hints

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Tag,
    create_model,
    model_validator,
)

from glvis.common.values import (
    FARTHEST,
    LARGEST_IMAGE,
    MOST,
    MOST_MOUNTS,
    Axis,
    Kind,
    Name,
    Names,
    Point,
    Positive,
    Size,
    Title,
    Weight,
    at_most,
    by_type,
    few,
    within,
)
from glvis.problem.expressions import parse_linear
from glvis.problem.layout import PLANES, Aim, Angles, Free, Mirror, Mount, Parameter, Ring, Vector
from glvis.problem.objective import OVERLAP_WEIGHTS, TERM_WEIGHTS, Objective
from glvis.problem.search_options import FOR_COMPARISON, METHODS, SearchOptions
from glvis.problem.swarm_options import SwarmOptions
from glvis.problem.visibility_options import VisibilityOptions
from glvis.study.sensor_table import SensorTable
from glvis.study.table import Table

_RESOLUTIONS = "be 'auto', 'sensor' or [width, height]"
_EDGES = "be 'auto', 'off' or a length greater than 0"
_NAME = re.compile(r"\w[\w.+ -]*")  # that files of a result can have


class FreeTable(Table):
    """``{ min, max, start, periodic }``: a number that may move."""

    min: float
    max: float
    start: float | None = None
    periodic: bool | None = None

    @model_validator(mode="after")
    def _ordered(self) -> FreeTable:
        self.to_free()
        return self

    def to_free(self) -> Free:
        """Return the same as the type that mounts know."""
        return Free(self.min, self.max, self.start, self.periodic)


def _to_parameter(value: float | FreeTable | str) -> Parameter:
    if isinstance(value, FreeTable):
        return value.to_free()
    return parse_linear(value) if isinstance(value, str) else value


if TYPE_CHECKING:
    Number = Parameter
else:
    Number = Annotated[
        Annotated[float, Tag("<number>")]
        | Annotated[FreeTable, Tag("<free>")]
        | Annotated[str, Tag("<text>")],
        Discriminator(
            by_type({str: "<text>", dict: "<free>", float: "<number>"}),
            custom_error_type="parameter",
            custom_error_message="must be a number, { min, max, start } or an expression",
        ),
        AfterValidator(_to_parameter),
    ]
Triple = Annotated[list[Number], within("have three entries", lambda v: len(v) == 3)]


class SceneTable(Table):
    """``[scene]``."""

    models: Annotated[Names, within("name at least one mesh", bool)]
    obstacles: Names = []
    assembly: Annotated[str, within("be a name of letters and digits", _NAME.fullmatch)] = ""
    scale: Positive | None = None  # from the unit of the file, where it says one
    flip: Annotated[
        Annotated[bool, Tag("<bool>")] | Annotated[Names, Tag("<names>")],
        Discriminator(
            by_type({bool: "<bool>", list: "<names>"}),
            custom_error_type="flip",
            custom_error_message="must be true, false or a list of models' names",
        ),
    ] = False
    max_edge: Annotated[
        Annotated[str, within(_EDGES, lambda v: v in ("auto", "off")), Tag("<word>")]
        | Annotated[float, within(_EDGES, lambda v: 0 < v <= FARTHEST), Tag("<length>")],
        Discriminator(
            by_type({str: "<word>", float: "<length>"}),
            custom_error_type="edge",
            custom_error_message=f"must {_EDGES}",
        ),
    ] = "auto"


class VisibilityTable(Table):
    """``[visibility]``."""

    criterion: Literal["pixels", "centroid"] = "pixels"
    min_pixels: Annotated[
        int,
        within("be at least 1", lambda v: v >= 1),
        within(f"be at most {LARGEST_IMAGE**2}", lambda v: v <= LARGEST_IMAGE**2),
    ] = 1
    resolution: Annotated[
        Annotated[str, within(_RESOLUTIONS, lambda v: v in ("auto", "sensor")), Tag("<word>")]
        | Annotated[Size, Tag("<size>")],
        Discriminator(
            by_type({str: "<word>", list: "<size>"}),
            custom_error_type="resolution",
            custom_error_message=f"must {_RESOLUTIONS}",
        ),
    ] = "auto"
    incidence: Literal["ray", "axis"] = "ray"
    occlusion: Literal["physical", "paper"] = "physical"
    semantics: Literal["paper"] | None = None

    def to_options(self) -> VisibilityOptions:
        """Return the options; ``semantics`` goes before the single choices."""
        given = self.given()
        if isinstance(self.resolution, list):
            given["resolution"] = (self.resolution[0], self.resolution[1])
        if given.pop("semantics", None) is None:
            return VisibilityOptions(**given)
        kept = {key: given[key] for key in ("resolution", "min_pixels") if key in given}
        return dataclasses.replace(VisibilityOptions.paper(), **kept)


class RingTable(Table):
    """``ring = { axis, radius, angle_deg, height }``."""

    axis: Literal["x", "y", "z"]
    radius: Number
    angle_deg: Number
    height: Number
    centre: Triple = [0.0, 0.0, 0.0]


class AnglesTable(Table):
    """``direction = { azimuth_deg, elevation_deg }``."""

    azimuth_deg: Number
    elevation_deg: Number


class MirrorTable(Table):
    """``mirror = { plane, name }`` or ``{ point, normal, name }``."""

    name: Name
    plane: Literal["yz", "xz", "xy"] | None = None
    point: Point = [0.0, 0.0, 0.0]
    normal: Axis | None = None

    @model_validator(mode="after")
    def _one_plane(self) -> MirrorTable:
        if (self.plane is None) == (self.normal is None):
            raise ValueError("needs either 'plane' or 'normal' (with 'point')")
        if self.plane and "point" in self.model_fields_set:
            raise ValueError("'plane' goes through the origin; 'point' goes with 'normal'")
        return self

    def to_mirror(self) -> Mirror:
        """Return the same as the type that mounts know."""
        normal = PLANES[self.plane] if self.plane else self.normal
        return Mirror(self.name, _triple(self.point), _triple(normal))


class MountTable(Table):
    """``[[mount]]``."""

    name: Name
    sensor: Name
    ring: RingTable | None = None
    position: Triple | None = None
    direction: (
        Annotated[
            Annotated[AnglesTable, Tag("<angles>")] | Annotated[Triple, Tag("<vector>")],
            Discriminator(
                by_type({dict: "<angles>", list: "<vector>"}),
                custom_error_type="direction",
                custom_error_message="must be { azimuth_deg, elevation_deg } or [x, y, z]",
            ),
        ]
        | None
    ) = None
    aim: Triple | None = None
    roll_deg: Number = 0.0
    mirror: MirrorTable | None = None

    @model_validator(mode="after")
    def _one_of_each(self) -> MountTable:
        for first, second in (("ring", "position"), ("direction", "aim")):
            if (getattr(self, first) is None) == (getattr(self, second) is None):
                raise ValueError(f"needs either '{first}' or '{second}'")
        return self

    def to_mount(self) -> Mount:
        """Return the same as the type that rigs are built of."""
        place: Any = self.position and _triple(self.position)
        if self.ring:
            ring = self.ring
            place = Ring(ring.axis, ring.radius, ring.angle_deg, ring.height, _triple(ring.centre))
        orientation: Angles | Vector | Aim
        if isinstance(self.direction, AnglesTable):
            orientation = Angles(self.direction.azimuth_deg, self.direction.elevation_deg)
        elif self.direction is not None:
            orientation = Vector(_triple(self.direction))
        else:
            orientation = Aim(_triple(self.aim))
        mirror = self.mirror.to_mirror() if self.mirror else None
        return Mount(self.name, self.sensor, place, orientation, self.roll_deg, mirror)


class ObjectiveTable(Table):
    """``[objective]``."""

    kind: Literal["of1", "of2", "of3"] = "of1"
    weights: Literal["set1", "set2"] = "set1"
    w_tot: Weight | None = None
    w_of1: Weight | None = None
    w_of2: Weight | None = None
    overlap: (
        Annotated[
            list[Weight],
            within("have at least one weight", bool),
            within(f"have at most {MOST_MOUNTS} weights", lambda v: len(v) <= MOST_MOUNTS),
        ]
        | None
    ) = None
    by_area: bool = True
    normalize: bool = True
    aggregate: Literal["mean", "min", "cvar"] = "mean"
    cvar_fraction: Annotated[float, within("lie in (0, 1]", lambda v: 0 < v <= 1)] = 0.5

    def to_objective(self) -> Objective:
        """Return the objective; single weights go before those of the set."""
        given = self.given()
        given.pop("weights", None)
        terms = dict(zip(("w_tot", "w_of1", "w_of2"), TERM_WEIGHTS[self.weights], strict=True))
        overlap = tuple(given.pop("overlap", OVERLAP_WEIGHTS[self.weights]))
        return Objective(**(terms | given), overlap=overlap)


def _table_of(options: Any) -> type[Table]:
    """Return a table with the fields of a dataclass; pairs are lists in TOML."""
    hints = get_type_hints(options)
    fields: dict[str, Any] = {}
    for field in dataclasses.fields(options):
        hint, default = hints[field.name], cast(Any, field.default)
        if hint == tuple[float, float]:
            hint = Annotated[
                list[float], within("be [low, high]", lambda v: len(v) == 2), AfterValidator(tuple)
            ]
            default = list(default)
        if field.name == "method":
            hint = Annotated[hint, BeforeValidator(_refuse_methods_for_comparison)]
        if field.name in MOST:
            hint = Annotated[hint, at_most(MOST[field.name])]
        fields[field.name] = (hint, default)
    return create_model(f"{options.__name__}Table", __base__=Table, **fields)


def _refuse_methods_for_comparison(method: Any) -> Any:
    """Return a method, unless it is one that was a study's once."""
    if method in FOR_COMPARISON:
        choice = ", ".join(f"'{one}'" for one in METHODS)
        raise ValueError(
            "is for comparison only, by tools/compare_methods.py in the checkout; choose one of "
            f"{choice}"
        )
    return method


if TYPE_CHECKING:
    SwarmTable = Table
    SearchTable = Table
else:
    SwarmTable = _table_of(SwarmOptions)
    SearchTable = _table_of(SearchOptions)


class StudyTable(Table):
    """A whole study file."""

    title: Title = ""
    unit: Literal["mm", "cm", "m", "in", "inch", "ft"] = "mm"
    up: Axis | None = None
    scene: SceneTable
    sensor: Annotated[dict[Kind, SensorTable], few("sensors")] = {}
    visibility: VisibilityTable = VisibilityTable()
    variables: Annotated[dict[str, Number], few("variables")] = {}
    mount: Annotated[list[MountTable], within("hold at least one mount", bool), few("mounts")]
    objective: ObjectiveTable = ObjectiveTable()
    swarm: SwarmTable = SwarmTable()
    search: SearchTable = SearchTable()
    vary: dict[str, Any] = {}  # of several runs; ``vary.py`` reads it

    def swarm_options(self) -> SwarmOptions:
        """Return the options of the swarm; what the table leaves open has its default."""
        return SwarmOptions(**self.swarm.given())

    def search_options(self) -> SearchOptions:
        """Return what searches; what the table leaves open has its default."""
        return SearchOptions(**self.search.given())


def _triple(values: Any) -> Any:
    return (values[0], values[1], values[2])

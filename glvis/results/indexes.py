"""The schema of ``result.json`` and of a series' index: what reading relies on, with limits.

Both may come from anywhere. Keys that nobody reads back may be anything.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AliasChoices, BaseModel, ConfigDict, Field

from glvis.common.values import FARTHEST, Title, between, within

_LONGEST = 10_000  # letters of a sentence; it may hold a path

_Text = Annotated[str, within(f"have at most {_LONGEST} letters", lambda v: len(v) <= _LONGEST)]
_Number = Annotated[float, between(-1e300, 1e300)]
_Percent = Annotated[float, between(0, 100.001)]
_Place = Annotated[float, between(-FARTHEST, FARTHEST)]
_Count = Annotated[int, between(0, 2**62)]
_Row = Annotated[list[_Place], within("have four numbers", lambda v: len(v) == 4)]
_Matrix = Annotated[list[_Row], within("have four rows", lambda v: len(v) == 4)]


class _Record(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class PoseEntry(_Record):
    """Where a sensor stands."""

    name: _Text
    camera_to_world: _Matrix


class VariableEntry(_Record):
    """A column of the position; None where poses came from elsewhere."""

    value: _Place | None


class ObjectiveEntry(_Record):
    """What the layout is worth."""

    kind: _Text
    by_area: bool
    value: _Number
    start_value: _Number


class PartEntry(_Record):
    """A file of a mesh that was put together from several."""

    sha256: _Text


class MeshEntry(_Record):
    """A mesh of the scene; its file may be made by formula."""

    name: _Text
    sha256: _Text | None = None
    parts: list[PartEntry] | None = None


class ModelEntry(MeshEntry):
    """A model, and its value."""

    value: _Number
    pieces: _Count | None = None


class MeanEntry(_Record):
    """Means over models."""

    percentage: _Percent
    area_percentage: _Percent


class SearchEntry(_Record):
    """What the search took."""

    stop_reason: _Text
    seed: _Count
    iterations: _Count
    evaluations: _Count
    maps_rendered: _Count


class ReachEntry(_Record):
    """What could be seen at best."""

    positions: _Count
    maps_rendered: _Count
    growth: _Number


class RunEntry(_Record):
    """Of the run itself."""

    seconds: Annotated[float, between(0, 1e12)]
    workers: Annotated[int, between(1, 10**6)]


class GlEntry(_Record):
    """Who drew."""

    vendor: _Text
    renderer: _Text
    version: _Text
    backend: _Text


class PosesIndex(_Record):
    """As much of ``result.json`` as poses need."""

    poses: list[PoseEntry]


class ResultIndex(PosesIndex):
    """All of ``result.json`` that is read back."""

    variables: list[VariableEntry]
    objective: ObjectiveEntry
    models: list[ModelEntry]
    mean: MeanEntry
    obstacles: list[MeshEntry]
    search: SearchEntry
    reach: ReachEntry | None = None
    warnings: list[_Text]
    run: RunEntry
    gl: GlEntry


class SeriesIndex(_Record):
    """What of a series' index leads to its runs."""

    title: Title
    vary: Annotated[
        dict[str, Any],
        within("hold no null", lambda v: not _has_null(v)),
        Field(validation_alias=AliasChoices("vary", "sweep")),  # the second by earlier builds
    ]
    repeats: Annotated[int, between(1, 2**62)]


def _has_null(value: Any) -> bool:
    """Return whether nested values have one that TOML cannot write."""
    if isinstance(value, dict | list):
        return any(map(_has_null, value.values() if isinstance(value, dict) else value))
    return value is None

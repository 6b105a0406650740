"""A study: meshes, sensors, where these may go, what counts as seen, what is to be maximised."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from glvis.common.notebook import html_table
from glvis.problem.mounts import Array, Rig, Variable
from glvis.problem.objective import Objective
from glvis.problem.scene import Model
from glvis.problem.search_options import SearchOptions
from glvis.problem.sensor import Sensor
from glvis.problem.swarm_options import SwarmOptions
from glvis.problem.visibility_options import VisibilityOptions


@dataclass(frozen=True, eq=False)
class Study:
    """What a study file says.

    Attributes
    ----------
    path : Path
        The file.
    text : str
        TOML as run: overrides written in, paths of meshes absolute.
    title, unit : str
        For reports; all lengths are in ``unit``.
    up : (3,) float64
        World direction that an unrolled image shows upright, unit length.
    models : tuple of Model
        What is to be seen, each on its own; large faces are cut into pieces by
        ``[scene] max_edge``, see ``pieces.py``.
    obstacles : tuple of Model
        What hides and is never counted.
    sensors : tuple of Sensor
        S of them, as ``rig.sensor_names``; the same object where the same kind.
    rig : Rig
        Positions to poses.
    visibility : VisibilityOptions
        Which faces count as seen.
    objective : Objective
        What the search maximises.
    swarm : SwarmOptions
        How the swarm searches.
    search : SearchOptions
        Which method searches, and what it may spend.
    vary : dict
        The table ``[vary]`` as written: no part of this study, nor of ``text``; see
        ``vary.plan_runs``.
    assumed : tuple of str
        Keys that the file leaves to their defaults and ``text`` names, such as "search.method".
    """

    path: Path
    text: str = field(repr=False)
    title: str
    unit: str
    up: Array
    models: tuple[Model, ...]
    obstacles: tuple[Model, ...]
    sensors: tuple[Sensor, ...]
    rig: Rig = field(repr=False)
    visibility: VisibilityOptions
    objective: Objective
    swarm: SwarmOptions
    search: SearchOptions = field(default_factory=SearchOptions)
    vary: Mapping[str, Any] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()

    def __repr__(self) -> str:
        counts = (
            (len(self.models), "model"),
            (len(self.obstacles), "obstacle"),
            (len(self.sensors), "sensor"),
            (len(self.variables), "variable"),
        )
        words = [f"{n} {noun}{'' if n == 1 else 's'}" for n, noun in counts]
        return f"Study({', '.join([repr(self.title), *words, self.objective.label])})"

    def _repr_html_(self) -> str:
        kinds = Counter(sensor.name for sensor in self.sensors)
        return html_table(
            self.title,
            (),
            [
                ("models", ", ".join(f"{one.name} ({one.n_faces:,} faces)" for one in self.models)),
                ("obstacles", ", ".join(one.name for one in self.obstacles) or "none"),
                ("sensors", ", ".join(f"{n} {kind}" for kind, n in kinds.items())),
                ("variables", str(len(self.variables))),
                ("objective", self.objective.label),
                ("search", self.search.method),
                ("lengths", self.unit),
            ],
        )

    @property
    def variables(self) -> tuple[Variable, ...]:
        """What the search may choose, one a column of a position."""
        return self.rig.variables

    @property
    def max_seconds(self) -> float | None:
        """After how many seconds the search ends, if so."""
        of_swarm = self.swarm.max_seconds if self.search.method == "swarm" else None
        limits = [limit for limit in (self.search.max_seconds, of_swarm) if limit is not None]
        return min(limits, default=None)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the S sensors."""
        return self.rig.sensor_names

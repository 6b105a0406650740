"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glvis.errors import StudyError

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="The study, a TOML file.")]
ResultFolder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a result.")]
Output = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the result; made new.")
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="A value in place of the study's, such as swarm.particles=100 or "
        "mount.A1.roll_deg=0; mount.*.sensor=kinect-v2 changes all, mounts=3 keeps the first "
        "three. May be given many times.",
    ),
]
Overwrite = Annotated[
    bool,
    typer.Option("--overwrite", help="Take the place of the result in DIR; other files stay."),
]
NoPictures = Annotated[
    bool, typer.Option("--no-pictures", help="Leave the pictures out; 'render' makes them later.")
]
AllPictures = Annotated[
    bool,
    typer.Option(
        "--all-pictures",
        help="Pictures of every model and every sensor, however many there are.",
    ),
]
Colors = Annotated[
    list[str] | None,
    typer.Option(
        "--color",
        metavar="KIND",
        help="Pictures of the models by pixel-size, density, depth-error or blur as well. May be "
        "given many times.",
    ),
]
NoMeshes = Annotated[
    bool,
    typer.Option(
        "--no-meshes",
        help="Leave the coloured meshes (PLY, glTF) out of exports/: about 85 bytes a face.",
    ),
]
Repeats = Annotated[
    int | None,
    typer.Option(min=1, help="Runs with this many seeds; says how much their results differ."),
]
Vary = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        metavar="KEY=VALUE,VALUE,...",
        help="Runs with each of the values, as mounts=2,3,4 or objective.kind=of1,of2; the same "
        "as a table \\[vary] in the study. Given many times: every combination.",
    ),
]


def _refuse_sweep(given: list[str] | None) -> None:
    if given:
        raise StudyError("--sweep is called --vary now: give it the same KEY=VALUE,VALUE,...")


Sweep = Annotated[  # the old name of --vary: refused, not unknown
    list[str] | None, typer.Option("--sweep", hidden=True, callback=_refuse_sweep, is_eager=True)
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Only list the runs and the maps they cost.")
]

"""The paper's two case studies for the tools, on the meshes of ``scenes/`` or another folder."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

try:
    from glvis.problem.study import Study
    from glvis.study.loading import load_study
except ImportError:
    sys.exit(
        "glvis is not installed in this Python; run tools/demo once, then .venv/bin/python TOOL"
    )

HERE = Path(__file__).resolve().parents[1]
SCENES = HERE / "scenes"
# Meshes that nobody here modelled lie beside the checkout, where there are any.
BESIDE = HERE.parent / "shared" / "data"

STUDIES = {
    "arms": "arm.toml",
    "arms-table-8": "arm-table8.toml",
    "kitchen-2": "kitchen-2.toml",
    "kitchen-3": "kitchen-3.toml",
    "kitchen-4": "kitchen-4.toml",
}


def study_file(case: str) -> Path:
    """Return the study of a case."""
    return SCENES / STUDIES[case]


def mesh_settings(case: str, data: Path | None, *, holder: bool = True) -> list[str]:
    """Return the ``--set`` values that put the meshes of ``data`` in place of the study's own.

    Parameters
    ----------
    case : str
        A key of STUDIES.
    data : Path or None
        With ``arms/arm*.stl``, ``arms/holder.stl`` and ``kitchen/kitchen.stl``; None leaves the
        study its own.
    holder : bool
        Whether the arms have their holder.
    """
    where = None if data is None else data / case.partition("-")[0]
    if case.startswith("kitchen"):
        return [] if where is None else [f"scene.models={_paths(where / 'kitchen.stl')}"]
    models = [] if where is None else [f"scene.models={_paths(where / 'arm*.stl')}"]
    if not holder:
        return [*models, "scene.obstacles=[]"]
    return models + ([] if where is None else [f"scene.obstacles={_paths(where / 'holder.stl')}"])


def case_study(
    case: str, data: Path | None, settings: Sequence[str] = (), *, holder: bool = True
) -> Study:
    """Return the study of a case; see ``mesh_settings``.

    Raises
    ------
    StudyError
        If the meshes are not there, or a setting is none.
    """
    return load_study(study_file(case), [*mesh_settings(case, data, holder=holder), *settings])


def _paths(path: Path) -> str:
    """Return a list of one path as TOML has it."""
    return json.dumps([str(path)], ensure_ascii=False)

"""glvis finds where to put cameras and depth sensors, and proves what each of them sees."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from glvis.errors import MachineError, StudyError
    from glvis.evaluation.evaluator import Evaluator
    from glvis.problem.camera import look_at
    from glvis.problem.objective import Objective
    from glvis.problem.sensor import Sensor
    from glvis.problem.study import Study
    from glvis.problem.visibility_options import VisibilityOptions
    from glvis.results.reading import read_result
    from glvis.search.placement import Placement, evaluate_poses, place_sensors
    from glvis.study.loading import load_study
    from glvis.visibility.visibility_map import VisibilityMap
    from glvis.visibility.visible_faces import visible_faces

__version__ = "0.1.0"
__all__ = [
    "Evaluator",
    "FisheyeLens",
    "MachineError",
    "Objective",
    "OpenCVLens",
    "Partner",
    "Pinhole",
    "Placement",
    "Sensor",
    "SphericalLens",
    "Study",
    "StudyError",
    "VisibilityMap",
    "VisibilityOptions",
    "__version__",
    "evaluate_poses",
    "find_sensor",
    "load_study",
    "look_at",
    "place_sensors",
    "read_result",
    "visible_faces",
]

# Where the public names live; imported when first asked for, as ``--help`` needs none of them.
_HOMES = {
    "Evaluator": "evaluation.evaluator",
    "FisheyeLens": "problem.calibrated_lens",
    "MachineError": "errors",
    "Objective": "problem.objective",
    "OpenCVLens": "problem.calibrated_lens",
    "Partner": "problem.sensor",
    "Pinhole": "problem.lens",
    "Placement": "search.placement",
    "Sensor": "problem.sensor",
    "SphericalLens": "problem.lens",
    "Study": "problem.study",
    "StudyError": "errors",
    "VisibilityMap": "visibility.visibility_map",
    "VisibilityOptions": "problem.visibility_options",
    "evaluate_poses": "search.placement",
    "find_sensor": "study.catalogue_sensors",
    "load_study": "study.loading",
    "look_at": "problem.camera",
    "place_sensors": "search.placement",
    "read_result": "results.reading",
    "visible_faces": "visibility.visible_faces",
}


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'glvis' has no attribute '{name}'")
    return getattr(import_module(f"glvis.{_HOMES[name]}"), name)

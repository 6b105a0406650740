"""glvis finds where to put cameras and depth sensors, and proves what each of them sees."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from glvis.camera import look_at
    from glvis.errors import MachineError, StudyError
    from glvis.inputs.sensor import Sensor
    from glvis.inputs.study import Study, load_study
    from glvis.optim.evaluator import Evaluator
    from glvis.optim.objective import Objective
    from glvis.optim.placement import Placement, evaluate_poses, place_sensors
    from glvis.outputs.reading import read_result
    from glvis.sight.visibility import VisibilityMap, VisibilityOptions
    from glvis.sight.visible_faces import visible_faces

__version__ = "0.1.0"
__all__ = [
    "Evaluator",
    "MachineError",
    "Objective",
    "Placement",
    "Sensor",
    "Study",
    "StudyError",
    "VisibilityMap",
    "VisibilityOptions",
    "__version__",
    "evaluate_poses",
    "load_study",
    "look_at",
    "place_sensors",
    "read_result",
    "visible_faces",
]

# Where the public names live; imported when first asked for, as ``--help`` needs none of them.
_HOMES = {
    "Evaluator": "optim.evaluator",
    "MachineError": "errors",
    "Objective": "optim.objective",
    "Placement": "optim.placement",
    "Sensor": "inputs.sensor",
    "Study": "inputs.study",
    "StudyError": "errors",
    "VisibilityMap": "sight.visibility",
    "VisibilityOptions": "sight.visibility",
    "evaluate_poses": "optim.placement",
    "load_study": "inputs.study",
    "look_at": "camera",
    "place_sensors": "optim.placement",
    "read_result": "outputs.reading",
    "visible_faces": "sight.visible_faces",
}


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'glvis' has no attribute '{name}'")
    return getattr(import_module(f"glvis.{_HOMES[name]}"), name)

"""The whole state of a search in one file, so that no more than an iteration is ever lost.

A file is written beside the old one and takes its place in one step: at any moment there is a
whole one. It holds arrays and JSON, no pickles, and says for which study it was made.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glvis.common.complaints import as_toml, checked, shortened
from glvis.common.files import json_value, read_npz, toml_tables
from glvis.errors import MachineError, StudyError
from glvis.evaluation.evaluator import POSE_BYTES
from glvis.problem.study import Study
from glvis.search.states import Head, check_inside, check_search, check_trace

VERSION = 2
_MOST_BYTES = 1 << 29  # that are read; a search of many variables keeps some megabytes
_SEARCH = "search."  # before the names of the search's own arrays
# What may change without another search: words for people, and where the meshes lie (they are
# compared themselves).
_FREE = ("title", "scene.models", "scene.obstacles")
_NOTHING = "nothing"


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A search between two iterations.

    Attributes
    ----------
    identity : dict
        What must not change in between; see ``identity_of``.
    search : dict of str to ndarray
        State of the search method.
    known_poses : (K, 16) uint8
        Poses whose maps have been counted; see ``Evaluator.known_poses``.
    run : dict
        JSON of whoever runs the search: seconds, counters.
    trace : bytes
        Its rows, JSON by line: a text that only grows, so that a long run's need not be written
        out anew each time.
    """

    identity: dict[str, Any]
    search: dict[str, NDArray[Any]]
    known_poses: NDArray[np.uint8]
    run: dict[str, Any]
    trace: bytes


def identity_of(study: Study) -> dict[str, Any]:
    """Return what of a study a search depends on: its text, its meshes, the order of columns."""
    return {
        "study": study.text,
        "variables": [variable.name for variable in study.variables],
        "meshes": {
            model.name: hashlib.sha256(model.vertices.tobytes() + model.faces.tobytes()).hexdigest()
            for model in (*study.models, *study.obstacles)
        },
    }


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint; until it is whole, the one before stays.

    Raises
    ------
    MachineError
        If it cannot be written.
    """
    head = {"version": VERSION, "identity": checkpoint.identity, "run": checkpoint.run}
    arrays = {_SEARCH + name: array for name, array in checkpoint.search.items()}
    part = path.with_name(f"{path.name}.part")
    try:
        part.unlink(missing_ok=True)  # left over from a kill, or a link to somewhere else
        with part.open("xb") as file:
            np.savez(
                file,
                allow_pickle=False,
                head=np.array(json.dumps(head)),
                known_poses=checkpoint.known_poses,
                trace=np.frombuffer(checkpoint.trace, dtype=np.uint8),
                **arrays,
            )
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise MachineError(f"{path}: cannot be written: {error.strerror or error}") from error


def read_checkpoint(path: Path, study: Study) -> Checkpoint:
    """Return the checkpoint in a file, made for this study.

    Raises
    ------
    StudyError
        If there is none, it cannot be read, or the study has changed since: what, from what,
        to what.
    """
    try:
        arrays = read_npz(path, _MOST_BYTES)
        head: Any = json_value(str(arrays["head"]))
        version = head["version"]
    except FileNotFoundError:
        raise StudyError(f"{path}: there is no checkpoint to go on from") from None
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (KeyError, TypeError, ValueError):
        raise StudyError(f"{path}: is no checkpoint of glvis") from None
    if version != VERSION:
        raise StudyError(
            f"{path}: is a checkpoint of version {as_toml(version)}; this glvis reads version "
            f"{VERSION}"
        )
    try:
        saved = checked(Head, head)
        change = next(_changes(head["identity"], identity_of(study)), None)
        if change:
            raise StudyError(f"the study has changed since: {change}")
        search = {
            name.removeprefix(_SEARCH): array
            for name, array in arrays.items()
            if name.startswith(_SEARCH)
        }
        trace, known_poses = (_bytes(arrays, *one) for one in (("trace", 1), ("known_poses", 2)))
        check_search(search, study, check_trace(trace.tobytes(), saved.run))
        if known_poses.shape[1] != POSE_BYTES:
            raise ValueError(f"known_poses must have {POSE_BYTES} columns")
        check_inside("start", np.array(saved.run.start), study)
    except StudyError as error:
        raise StudyError(f"{path}: {error}") from None
    except ValueError as error:
        raise StudyError(f"{path}: is a broken checkpoint: {error}") from None
    return Checkpoint(head["identity"], search, known_poses, head["run"], trace.tobytes())


def _bytes(arrays: Mapping[str, NDArray[Any]], name: str, ndim: int) -> NDArray[np.uint8]:
    """Return an array of bytes with so many axes."""
    found = arrays.get(name)
    if found is None or found.dtype != np.uint8 or found.ndim != ndim:
        raise ValueError(f"{name} is missing or of another type")
    return found


def _changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield in words what differs between two identities."""
    old, new = (_flatten(toml_tables(identity["study"])) for identity in (then, now))
    for key in dict.fromkeys([*old, *new]):
        before, after = old.get(key, _NOTHING), new.get(key, _NOTHING)
        if before != after and not key.startswith(_FREE):
            yield f"{shortened(key)}: {shortened(before)} -> {shortened(after)}"
    if then["variables"] != now["variables"]:
        names = (shortened(", ".join(identity["variables"])) for identity in (then, now))
        yield "order of variables: " + " -> ".join(names)
    if list(then["meshes"]) != list(now["meshes"]):
        names = (shortened(", ".join(identity["meshes"])) for identity in (then, now))
        yield "meshes: " + " -> ".join(names)
    for name, digest in then["meshes"].items():
        if now["meshes"].get(name) != digest:
            yield f"mesh {shortened(name)}: other vertices or faces than before"


def _flatten(table: Any, above: str = "") -> dict[str, str]:
    """Return the values of nested tables by dotted key, as JSON; mounts go by their names."""
    if isinstance(table, dict):
        entries = list(table.items())
    elif isinstance(table, list) and table and all(isinstance(entry, dict) for entry in table):
        entries = [(entry.get("name", place), entry) for place, entry in enumerate(table)]
    else:
        return {above: json.dumps(table, ensure_ascii=False, default=str)}
    flat: dict[str, str] = {}
    for key, value in entries:
        flat |= _flatten(value, f"{above}.{key}" if above else str(key))
    return flat


def _sync_folder(folder: Path) -> None:
    """Make a rename last over a loss of power."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)

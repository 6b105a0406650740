"""Every key of a study: what it means, what it may be, what it is where a study leaves it out.

The schema knows keys and defaults; here are the words. A key without words fails a test.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from glvis.errors import StudyError
from glvis.problem.expressions import nearest
from glvis.study.overrides import toml_text
from glvis.study.schema import (
    AnglesTable,
    FreeTable,
    MirrorTable,
    MountTable,
    ObjectiveTable,
    RingTable,
    SceneTable,
    SearchTable,
    StudyTable,
    SwarmTable,
    VisibilityTable,
)
from glvis.study.sensor_table import FocusTable, NoiseTable, PartnerTable, SensorTable
from glvis.study.table import Table


@dataclass(frozen=True)
class KeyTable:
    """A table of the study file in words.

    Attributes
    ----------
    name : str
        As the file writes its header, "[scene]"; of a table in braces its key, "ring".
    about : str
        What it is for, a sentence.
    schema : type of Table, optional
        What knows its defaults; None where names are the user's own.
    meanings : dict of str to str
        By key.
    """

    name: str
    about: str
    schema: type[Table] | None
    meanings: dict[str, str]

    def rows(self) -> Iterator[tuple[str, str, str]]:
        """Yield key, default (or "needed") and meaning of each key."""
        fields = self.schema.fields_by_key() if self.schema else {}
        for key, meaning in self.meanings.items():
            field = fields.get(key)
            default = "needed" if field and field.is_required() else ""
            if field and not field.is_required() and field.default is not None:
                default = toml_text(field.default)
            yield key, default, meaning


_LENS_MEANINGS = {
    "lens": '"pinhole", "opencv" (focal_px and distortion), "fisheye" (OpenCV\'s) or "spherical" '
    "(lidar, 360 degrees)",
    "hfov_deg": "pinhole: horizontal field of view, degrees",
    "vfov_deg": "pinhole: vertical field of view, degrees",
    "focal_px": "[fx, fy], pixels; or hfov_deg and vfov_deg",
    "centre_px": "[cx, cy], pixels, of which centres have whole numbers; the middle without it",
    "distortion": "opencv: [k1, k2, p1, p2, k3, k4, k5, k6], 4, 5 or 8 of them; fisheye: "
    "[k1, k2, k3, k4]",
    "max_angle_deg": "half angle of a cone about the optical axis, beyond which there is no image",
    "azimuth_deg": "spherical: range about the optical axis, up to 360",
    "elevation_deg": "spherical: [lowest, highest] angle above the plane of right and axis",
}

KEY_TABLES = (
    KeyTable(
        "a study",
        "Keys above the first table.",
        StudyTable,
        {
            "title": "for pictures and the page; the name of the file without one",
            "unit": "of all lengths: mm, cm, m, in, inch or ft; a single length may have its own, "
            'as "200 mm"',
            "up": "direction that an image without roll shows upright; +Y of glTF, else +Z",
        },
    ),
    KeyTable(
        "[scene]",
        "Meshes, by their files beside the study; globs are allowed.",
        SceneTable,
        {
            "models": "what is to be seen, each file on its own",
            "obstacles": "what hides what lies behind it and is never counted",
            "assembly": "a name: all models together are one, as a robot's links are",
            "scale": "factor of all coordinates in the files; told by the file's own unit where it "
            "has one (glTF, 3MF), else 1",
            "flip": "true, or a list of models: their normals point the other way",
            "max_edge": '"auto" cuts faces that are large beside a view into pieces; a length '
            'cuts to that; "off" leaves them whole, and a face counts whole',
        },
    ),
    KeyTable(
        "[sensor.NAME]",
        "A camera or depth sensor, once for all mounts that name it.",
        SensorTable,
        {
            "from": "an entry of the catalogue, whose keys it has; those beside it go before them",
            "calibration": "file of OpenCV, ROS (camera_info) or kalibr, beside the study: its "
            'lens and resolution; "chain.yaml#cam1" is the second camera of a chain',
            **_LENS_MEANINGS,
            "resolution": "pixels, [width, height], of a lidar columns and beams; of the catalogue "
            "or a calibration another number of pixels in the same field of view",
            "min_distance": "where its range begins, see distance",
            "max_distance": "where its range ends; needed, without from",
            "max_incidence_deg": "largest angle between a face's normal and the way to the "
            "sensor: 0 looks straight at it, 90 edge on",
            "distance": 'what the range measures: "depth" along the optical axis, or "range" from '
            'the optical centre; "range" for a spherical lens, else "depth"',
            "partner": "a second viewpoint fixed to it, by which a point must be seen as well",
            "noise": "how far its depths are off",
            "focus": "what decides how sharp it sees",
            "emits": "name of a group of projectors that disturb each other",
            "cost": "of one, in any currency",
        },
    ),
    KeyTable(
        "partner",
        "In [sensor.NAME]: partner = { offset, turn_deg, role }, with the sensor's lens, or with "
        "keys of a lens of its own.",
        PartnerTable,
        {
            "offset": "[right, up, back]: its optical centre in the camera frame of the sensor",
            "turn_deg": "[yaw, pitch] of its optical axis against the sensor's: to the right, up",
            "role": '"imager" or "projector"',
            **_LENS_MEANINGS,
            "resolution": "pixels, [width, height], that focal_px means; the sensor's without it",
        },
    ),
    KeyTable(
        "noise",
        "In [sensor.NAME]: noise = { subpixel } or { polynomial, by_incidence }, 1 sigma of a "
        "depth.",
        NoiseTable,
        {
            "subpixel": "error of a disparity in pixels: stereo and structured light, with partner",
            "polynomial": "[a, b, c, ...] of a + b z + c z^2 ... in the study's unit",
            "by_incidence": "whether the error is divided by the cosine of the incidence",
        },
    ),
    KeyTable(
        "focus",
        "In [sensor.NAME]: focus = { focal_length, f_number, distance, pixel_pitch }.",
        FocusTable,
        {
            "focal_length": "of the lens",
            "f_number": "focal length by the diameter of the aperture",
            "distance": "what is in focus, along the optical axis",
            "pixel_pitch": 'width of a pixel on the chip, as a length: "0.00345 mm"',
        },
    ),
    KeyTable(
        "[visibility]",
        "Which faces count as seen.",
        VisibilityTable,
        {
            "criterion": '"pixels": the face shows; "centroid": its centre of mass is free',
            "min_pixels": 'for "pixels": how many of them must show a face',
            "resolution": '"auto": points of faces are asked about; "sensor" or [width, height]: '
            "pixels decide",
            "incidence": 'measured from the true "ray" or from the optical "axis"',
            "occlusion": '"physical": faces that the sensor refuses hide, too; not so for "paper"',
            "semantics": '"paper": all choices of the paper at once',
        },
    ),
    KeyTable(
        "[variables]",
        'Numbers by names of your own, for expressions such as "180 - 2*alpha".',
        None,
        {"NAME": "{ min, max, start, periodic }, a number or an expression of other names"},
    ),
    KeyTable(
        "[[mount]]",
        "A sensor and what of its pose may move. NUMBER is a number, which is fixed, "
        "{ min, max, start }, which is free, or an expression of variables in quotes.",
        MountTable,
        {
            "name": "of the sensor, in tables and pictures",
            "sensor": "which one: of a table [sensor.NAME], or of the catalogue that "
            "'glvis sensors' lists",
            "position": "[NUMBER, NUMBER, NUMBER]; or ring",
            "ring": "a place on a circle; or position",
            "aim": "[NUMBER, NUMBER, NUMBER], the point it looks at; or direction",
            "direction": "[x, y, z] or { azimuth_deg, elevation_deg } of the optical axis; or aim",
            "roll_deg": "NUMBER: turn about the optical axis, degrees by the right-hand rule",
            "mirror": "a second sensor on the other side of a plane",
        },
    ),
    KeyTable(
        "ring",
        "In [[mount]]: ring = { axis, radius, angle_deg, height, centre }.",
        RingTable,
        {
            "axis": '"x", "y" or "z", through the centre',
            "radius": "NUMBER",
            "angle_deg": "NUMBER: 0 is the next axis (+X for z), 90 the one after it",
            "height": "NUMBER: along the axis, from the centre",
            "centre": "[NUMBER, NUMBER, NUMBER]",
        },
    ),
    KeyTable(
        "direction",
        "In [[mount]]: direction = { azimuth_deg, elevation_deg }.",
        AnglesTable,
        {
            "azimuth_deg": "NUMBER: from +X towards +Y",
            "elevation_deg": "NUMBER: above the XY plane, towards +Z",
        },
    ),
    KeyTable(
        "mirror",
        "In [[mount]]: mirror = { plane, name } or { point, normal, name }.",
        MirrorTable,
        {
            "name": "of the second sensor",
            "plane": '"yz", "xz" or "xy", through the origin; or normal',
            "point": "on the plane, with normal",
            "normal": "of the plane; or plane",
        },
    ),
    KeyTable(
        "{ min, max }",
        "A number that the search may choose: { min, max, start, periodic }.",
        FreeTable,
        {
            "min": "the least it may be",
            "max": "the most it may be",
            "start": "where the search begins; the middle without one",
            "periodic": "whether max is the same as min; told by the range without it",
        },
    ),
    KeyTable(
        "[objective]",
        "What the search maximises.",
        ObjectiveTable,
        {
            "kind": '"of1": the share that at least one sensor sees; "of2": weights by how many '
            'see it; "of3": both, after the paper',
            "by_area": "whether faces weigh by their area, or one each",
            "aggregate": 'over several models: "mean", "min" (the worst one) or "cvar"',
            "cvar_fraction": 'for "cvar": the mean over this share of the models, the worst ones',
            "weights": 'for "of2" and "of3": "set1" or "set2" of the paper; 4 views and more are '
            "punished",
            "overlap": "in place of those: weights of what exactly 1, 2, ... sensors see; the "
            "last one holds from there on",
            "w_tot": 'for "of3": weight of all views together; of the set without it',
            "w_of1": 'for "of3": weight of what is seen at all; of the set without it',
            "w_of2": 'for "of3": weight of "of2"; of the set without it',
            "normalize": 'for "of2" and "of3": divide by all faces (or their area)',
        },
    ),
    KeyTable(
        "[search]",
        "What searches, and for how long.",
        SearchTable,
        {
            "method": '"auto", "swarm" (the paper\'s) or "greedy"',
            "max_maps": "end before more maps (of one sensor on one model) are rendered; without "
            "it 4,000 a sensor and model, or the swarm's iterations",
            "max_seconds": "end after the iteration that takes the run past this",
        },
    ),
    KeyTable(
        "[swarm]",
        'Options of method = "swarm", Table 5 of the paper. Every method has the seed.',
        SwarmTable,
        {
            "seed": "of the random numbers: the same seed, the same run",
            "particles": "in the swarm",
            "iterations": "moves of the swarm at most",
            "stall_iterations": "end where the best value has changed by less than tolerance "
            "over so many",
            "tolerance": "see stall_iterations",
            "tolerance_mode": 'tolerance as a share of the best value: "relative"; "matlab": at '
            "least of 1",
            "inertia": "[least, most]",
            "inertia_update": 'adapts "always" or "on_improvement"',
            "min_neighbors_fraction": "share of the swarm that a particle looks at, at least",
            "initial_span": "largest initial speed, in the units of the variables",
            "cognitive": "weight of a particle's own best",
            "social": "weight of its neighbours' best",
            "initial": 'first positions: "sobol" (even) or "uniform" (random)',
            "objective_limit": "end at a value of at least this",
            "max_seconds": "end after the iteration that takes the run past this",
        },
    ),
    KeyTable(
        "[vary]",
        "Runs with each of several values, every combination.",
        None,
        {"KEY": "[VALUE, ...]: any key in dots, as objective.kind, mount.*.sensor, or mounts"},
    ),
)


def tables_about(word: str = "") -> list[KeyTable]:
    """Return the tables whose name holds a word, or else those with such a key; all without one.

    Raises
    ------
    StudyError
        If there is neither.
    """
    found = [table for table in KEY_TABLES if word in table.name]
    found = found or [table for table in KEY_TABLES if word in table.meanings]
    if not found:
        known = [table.name.strip("[]") for table in KEY_TABLES]
        known += [key for table in KEY_TABLES for key in table.meanings]
        raise StudyError(f"there is no table and no key '{word}' in a study{nearest(word, known)}")
    return found

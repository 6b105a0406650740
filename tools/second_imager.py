#!/usr/bin/env python3
"""Studies the paper's arm scanner anew with the exact D415: what both of its imagers see.

    tools/second_imager.py                        # searches with one viewpoint and with two
    tools/second_imager.py --found out/reproduce/paper/arms-1    # and judges a layout found before
    tools/second_imager.py --maps 20000           # shorter searches; the page says so

The paper counts a face as seen where one pinhole sees it. The camera measures depth where its two
imagers, 55 mm apart, both do. Writes ``scenes/second-imager.md`` and its picture.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from casestudies import HERE, case_study

from glvis.cli.streams import patient_streams
from glvis.cli.terminal import duration, say
from glvis.common.palette import OKABE_ITO, SEEN_COLOR, rgb
from glvis.errors import MachineError, StudyError
from glvis.evaluation.workers import available_cores
from glvis.pictures.coloring import Coloring, Swatch, opaque, share
from glvis.pictures.scenesheets import SIZE, close_sheet
from glvis.pictures.stage import Stage
from glvis.problem.search_options import SearchOptions
from glvis.problem.sensor import Partner
from glvis.problem.study import Study
from glvis.results.reading import read_result
from glvis.search.placement import Placement, evaluate_poses, place_sensors

# IntelRealSense/realsense-ros, realsense2_description/urdf/_d415.urdf.xacro: the right imager.
BASELINE = 55.0
ARM = "arm5"  # whose picture is shown
PICTURE = f"second-imager-{ARM}.png"
_LOST, _UNSEEN = rgb(OKABE_ITO[5]), rgb("#3C4048")


@dataclass(frozen=True, eq=False)
class Layout:
    """A layout, judged both ways.

    Attributes
    ----------
    name : str
        Whose it is.
    one, two : Placement
        By the single pinhole, and by both imagers.
    """

    name: str
    one: Placement
    two: Placement


def main() -> int:
    """Search, judge, write the page."""
    arguments = _arguments()
    study = case_study("arms", arguments.data, ["swarm.seed=1"])
    study = replace(study, search=SearchOptions("auto", max_maps=arguments.maps))
    paired = with_partner(study)
    table_8 = case_study("arms-table-8", arguments.data)
    found = {"the paper's own (Table 8), found for other arms": evaluate_poses(table_8)}
    if arguments.found:
        found["the paper's swarm, by the pinhole"] = read_result(arguments.found)
    one, two = _searched(study, arguments.workers), _searched(paired, arguments.workers)
    found["auto, by the pinhole"], found["auto, by both imagers"] = one, two
    layouts = [
        Layout(
            name,
            evaluate_poses(study, placement.camera_to_world),
            evaluate_poses(paired, placement.camera_to_world),
        )
        for name, placement in found.items()
    ]
    arguments.docs.mkdir(parents=True, exist_ok=True)
    (arguments.docs / "pictures").mkdir(exist_ok=True)
    shown = layouts[-2 if not arguments.found else 1]
    draw(shown, arguments.docs / "pictures" / PICTURE)
    page = arguments.docs / "second-imager.md"
    page.write_text("\n".join(page_lines(layouts, shown, one, two)) + "\n", encoding="utf-8")
    say(f"The page is {page}")
    return 0


def with_partner(study: Study) -> Study:
    """Return a study whose cameras see what their two imagers see."""
    sensors = tuple(
        replace(sensor, partner=Partner((BASELINE, 0.0, 0.0), sensor.lens))
        for sensor in study.sensors
    )
    return replace(study, sensors=sensors)


def coverage(placement: Placement) -> float:
    """Return the mean over models of the percentage of faces seen, as the paper's Table 9."""
    return 100 * float(np.mean([found.coverage for found in placement.maps]))


def draw(layout: Layout, path: Path) -> None:
    """Write the picture: which faces of an arm only the pinhole sees."""
    study = layout.two.study
    index = [model.name for model in study.models].index(ARM)
    by_one, by_two = (found.maps[index].counts > 0 for found in (layout.one, layout.two))
    kinds = np.select([by_two, by_one], [0, 1], default=2)
    model = study.models[index]
    rows = [
        Swatch(color, label, share(float(np.mean(kinds == kind))))
        for kind, (color, label) in enumerate(
            [
                (SEEN_COLOR, "by both imagers"),
                (_LOST, "by the pinhole alone"),
                (_UNSEEN, "by none"),
            ]
        )
    ]
    painted = Coloring(
        "What the second imager takes away",
        opaque(np.array([SEEN_COLOR, _LOST, _UNSEEN])[kinds]),
        rows,
        note=f"{model.name}, eight D415, imagers {BASELINE:g} mm apart; layout: {layout.name}.",
    )
    with Stage(study, layout.two.camera_to_world) as stage:
        stage.show(index, layout.two.maps[index])
        stage.paint(painted.colors)
        close_sheet(stage, painted, SIZE).save(path)


def page_lines(
    layouts: Sequence[Layout], shown: Layout, one: Placement, two: Placement
) -> Iterator[str]:
    """Yield the page, Markdown."""
    yield "# The arm scanner with the exact D415"
    yield ""
    yield (
        "The paper counts a face as seen where one pinhole sees it, and so does "
        "[the reproduction](reproduced.md). The camera itself measures depth where its two "
        f"imagers, {BASELINE:g} mm apart, both see a point: at its working distance of 160 to "
        "350 mm that is a quarter to a ninth of the image's width without depth, and whatever "
        "hides from one of them. Here the first imager stands where the paper has its camera, "
        "and the second beside it (`partner` in the study); all else is as in the paper."
    )
    yield ""
    yield (
        "Made by `tools/second_imager.py`; no number is typed. Faces seen, the mean over the six "
        "arms with their holder:"
    )
    yield ""
    yield "| layout | by one pinhole | by both imagers | of it remains |"
    yield "| --- | ---: | ---: | ---: |"
    for layout in layouts:
        first, second = coverage(layout.one), coverage(layout.two)
        yield (f"| {layout.name} | {first:.1f} % | {second:.1f} % | {100 * second / first:.1f} % |")
    yield ""
    yield (
        f'The searches are `method = "auto"`: {one.maps_rendered:,} maps in '
        f"{duration(one.seconds)} by the pinhole, {two.maps_rendered:,} in "
        f"{duration(two.seconds)} by both imagers; they maximise the paper's OF3."
    )
    yield ""
    yield f"![Faces that only the pinhole sees](pictures/{PICTURE})"
    yield ""
    yield (
        f"{ARM} by the layout of {shown.name}: orange is what the pinhole promises and the camera "
        "does not see."
    )


def _searched(study: Study, workers: int) -> Placement:
    say(f"searching with {study.sensors[0]}", error=True)
    return place_sensors(study, workers=workers)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--found", type=Path, metavar="DIR", help="a result of the arm study")
    parser.add_argument("--maps", type=int, help="of each search; else 4,000 a sensor and model")
    parser.add_argument("--data", type=Path, metavar="DIR", help="meshes: arms/")
    parser.add_argument("--workers", type=int, default=available_cores())
    parser.add_argument("--docs", type=Path, default=HERE / "scenes", help="where the page goes")
    return parser.parse_args()


if __name__ == "__main__":
    try:
        with patient_streams():
            sys.exit(main())
    except (StudyError, MachineError) as problem:
        sys.exit(f"second_imager: {problem}")

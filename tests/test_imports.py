"""The arrows between modules: each imports only from rows above its own, as this table says."""

import ast
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "glvis"

# module: what it may import from glvis, all of it in rows above
ARROWS = {
    "errors": "",
    "hints": "",
    "notebook": "",
    "camera": "",
    "objective": "",
    "glsl": "",
    "palette": "",
    "places": "",
    "box": "",
    "rotations": "",
    "expressions": "",
    "complaints": "",
    "streams": "",
    "meshfiles": "complaints",
    "units": "",
    "welding": "",
    "files": "complaints",
    "lock": "errors",
    "meshlimits": "files",
    "values": "complaints files",
    "meshpaths": "complaints errors files",
    "swarm_options": "",
    "search_options": "",
    "auto_options": "",
    "trace": "",
    "progress": "",
    "script": "auto_options box errors",
    "greedy": "script",
    "local_search": "script",
    "auto": "greedy local_search script",
    "sensor": "camera",
    "scene": "meshfiles welding complaints meshlimits",
    "layout": "expressions",
    "mounts": "camera expressions layout",
    "visibility": "sensor",
    "filters": "scene sensor visibility",
    "occlusion": "",
    "clusters": "scene",
    "points": "scene sensor clusters filters occlusion visibility",
    "coincident": "scene sensor points",
    "context": "errors",
    "surface": "clusters context errors glsl",
    "views": "camera sensor filters visibility",
    "gpu_scene": "scene clusters surface",
    "culling": "gpu_scene views",
    "renderer": "camera context errors surface views",
    "draw": "coincident culling gpu_scene renderer surface views visibility",
    "rays": "culling filters gpu_scene occlusion points surface views visibility",
    "paper": "scene culling filters gpu_scene occlusion points views visibility",
    "batch": "culling filters gpu_scene points surface views",
    "cast": "sensor batch clusters context culling gpu_scene points rays surface views visibility",
    "pieces": "scene sensor visibility",
    "regions": "scene",
    "swarm": "box swarm_options",
    "schema": "camera complaints expressions layout objective search_options sensor swarm_options"
    " units values visibility",
    "lengths": "schema",
    "overrides": "complaints errors expressions files schema",
    "keys": "errors expressions overrides schema",
    "json_schema": "keys schema units",
    "study": "errors complaints expressions files lengths meshpaths mounts notebook objective"
    " overrides pieces scene schema sensor search_options swarm_options units visibility",
    "winding": "scene welding",
    "checks": "camera filters mounts points scene study units winding",
    "selftest": "camera scene sensor batch cast clusters context culling errors filters gpu_scene"
    " points renderer surface views",
    "maps": "scene sensor cast context culling draw gpu_scene paper rays selftest study views"
    " visibility",
    "visible_faces": "scene sensor maps visibility",
    "evaluator": "scene sensor context visibility objective study maps",
    "worker": "maps",
    "jobs": "maps",
    "workers": "context errors jobs maps",
    "remote": "context errors maps",
    "cluster": "errors hints jobs maps remote",
    "surrogate": "auto_options filters sensor study",
    "search": "auto auto_options box errors greedy script search_options study surrogate swarm",
    "states": "complaints files study swarm_options trace values",
    "checkpoint": "complaints errors evaluator files states study",
    "run": "checkpoint errors evaluator progress script search study trace",
    "reach": "box checkpoint evaluator visibility",
    "placement": "camera checkpoint cluster context evaluator maps notebook pieces progress reach"
    " run script study trace visibility workers",
    "journal": "errors",
    "folder": "errors hints files journal lock",
    "indexes": "values",
    "tables": "objective pieces scene visibility",
    "within_reach": "pieces placement reach scene visibility",
    "estimate": "context evaluator pieces scene search_options sensor study search",
    "vary": "complaints errors estimate files overrides sensor study",
    "result": "camera folder pieces placement scene study tables visibility within_reach journal",
    "reading": "context errors folder placement reach result scene study visibility complaints"
    " files indexes",
    "given_poses": "camera complaints errors files folder indexes reading rotations schema study",
    "framing": "camera",
    "normals": "",
    "shading": "camera context errors framing glsl normals",
    "coloring": "filters palette pieces places scene sensor visibility",
    "glyphs": "sensor",
    "sheet": "coloring places",
    "plots": "palette trace",
    "seriesplots": "palette plots",
    "stage": "camera coloring context framing glyphs palette sensor shading study visibility"
    " winding",
    "gapviews": "framing regions stage",
    "scenesheets": "camera coloring framing places sheet stage gapviews palette",
    "sensorsheets": "coloring palette places scenesheets sheet stage",
    "modelsheets": "coloring places scenesheets sheet stage visibility",
    "selection": "pieces study visibility",
    "pictures": "coloring plots scenesheets sensorsheets sheet stage study visibility modelsheets"
    " selection trace",
    "page": "filters glsl palette places",
    "mounting": "camera placement",
    "export_poses": "camera files mounting palette placement result rotations schema study",
    "export_surfaces": "coloring export_poses palette pieces placement rotations scene schema"
    " sensor",
    "explain": "filters placement scene study visibility",
    "report": "explain mounting page placement result tables within_reach",
    "delivery": "errors files export_poses export_surfaces folder hints mounting page pictures"
    " placement reading report result selection",
    "spread": "camera errors estimate folder placement sensor vary reading",
    "series_tables": "folder overrides reading result seriesplots spread vary journal",
    "series": "delivery errors folder placement series_tables spread study vary complaints"
    " indexes journal lock",
    "doctor": "context result selftest",
    "terminal": "placement",
    "wording": "errors estimate pieces placement study swarm_options tables terminal visibility"
    " within_reach checks winding",
    "explain_words": "explain mounting placement tables terminal regions",
    "tolerance": "errors evaluator mounting pieces placement schema visibility",
    "tolerance_words": "mounting pieces placement terminal tolerance",
    "series_words": "hints series_tables spread vary terminal",
    "compare": "camera coloring palette pieces placement scene scenesheets schema sheet stage"
    " tables terminal",
    "starter_meshes": "",
    "starter_texts": "",
    "starter_layout": "camera scene schema sensor starter_texts units winding",
    "starter_study": "errors scene starter_layout starter_texts units winding",
    "starter": "errors hints json_schema meshpaths starter_meshes starter_texts starter_layout"
    " starter_study units",
    "manual": "errors expressions",
    "cli_options": "errors",
    "cli_manual": "errors json_schema keys manual terminal",
    "cli_results": "cli_options compare delivery errors explain_words folder placement reading"
    " terminal tolerance tolerance_words",
    "cli_series": "delivery errors hints placement series series_tables series_words study vary"
    " terminal folder",
    "cli": "checks cli_manual cli_options cli_results cli_series complaints delivery doctor errors"
    " estimate files folder given_poses placement reach reading starter starter_study streams study"
    " terminal wording workers",
    "__main__": "cli",
    # the public names
    "__init__": "camera errors scene sensor study visibility visible_faces objective evaluator"
    " placement reading result",
}

# foreign library: the only modules that may talk to it
DOORS = {
    "moderngl": "context renderer shading surface",
    "PIL": "sheet",
    "matplotlib": "plots",
    "glcontext": "context",
    "trimesh": "scene",
    "pyswarms": "swarm",
    "pydantic": "schema complaints indexes states study values",
    "typer": "cli cli_manual cli_options cli_results cli_series",
    "distributed": "cluster remote",
    "cma": "",  # tools/methods has it
    "embreex": "",  # the rival that tools/bench measures; never part of the product
}

# by name alone: no two modules share one, whatever folder they lie in
MODULES = {
    path.stem: path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path.parent == PACKAGE or path.stem != "__init__"
}


@cache
def imported(path: Path) -> set[str]:
    """Return the dotted names that a module imports anywhere, ``glvis.`` in front of its own."""
    names = set()
    inside = ["glvis", *path.relative_to(PACKAGE).parts[:-1]]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = inside[: len(inside) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            names.add(source)
            # ``from glvis import camera`` means the module, if there is one
            names.update(f"{source}.{alias.name}" for alias in node.names)
    return names


def own_modules(names: set[str]) -> set[str]:
    """Return the modules of glvis among dotted names."""
    short = {name.rpartition(".")[2] for name in names if name.startswith("glvis.")}
    return {name for name in short if name in MODULES}


@pytest.mark.parametrize("module", MODULES)
def test_module_imports_only_what_the_table_allows(module):
    assert module in ARROWS, f"add glvis/{module} to the table: what may it import?"
    unasked = own_modules(imported(MODULES[module])) - set(ARROWS[module].split()) - {module}
    assert not unasked, f"glvis/{module} imports {', '.join(sorted(unasked))}"


@pytest.mark.parametrize("library", DOORS)
def test_foreign_library_is_met_behind_its_own_door_only(library):
    allowed = set(DOORS[library].split())
    users = {
        module
        for module, path in MODULES.items()
        if library in {name.split(".")[0] for name in imported(path)}
    }
    assert users <= allowed, f"{library} is for {allowed or 'nobody'}, not for {users - allowed}"


def test_table_reads_downwards():
    above: set[str] = set()
    for module, allowed in ARROWS.items():
        assert set(allowed.split()) <= above, f"{module} would import from a row below its own"
        above.add(module)


def test_reader_of_imports_knows_every_form(tmp_path, monkeypatch):
    monkeypatch.setattr(f"{__name__}.PACKAGE", tmp_path)
    (tmp_path / "viewer").mkdir()
    source = tmp_path / "viewer" / "page.py"
    source.write_text(
        "import glvis.camera\nfrom glvis import scene\nfrom glvis.sensor import Sensor\n"
        "from ..study import Study\nfrom .. import result\nfrom . import text\n"
        "def later():\n    import pyswarms.backend\n"
    )
    names = imported(source)
    for name in ("camera", "scene", "sensor", "study", "result", "viewer.text"):
        assert f"glvis.{name}" in names
    assert "pyswarms.backend" in names

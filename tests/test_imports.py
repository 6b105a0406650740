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
    "progress": "",
    "script": "box errors swarm_options",
    "greedy": "script",
    "refine": "box script",
    "covariance": "errors hints script",
    "differential": "script",
    "climb": "script",
    "rivals": "climb script",
    "auto": "climb greedy rivals script",
    "sensor": "camera",
    "scene": "meshfiles welding complaints meshlimits",
    "layout": "expressions",
    "mounts": "camera expressions layout",
    "clusters": "scene",
    "crops": "scene sensor clusters",
    "coincident": "scene sensor crops",
    "context": "errors",
    "surface": "clusters context errors glsl",
    "views": "camera sensor",
    "renderer": "camera context errors surface views",
    "culling": "renderer surface views",
    "points": "scene sensor clusters surface",
    "batch": "culling points surface views",
    "caster": "batch clusters context culling points surface views",
    "visibility": "sensor",
    "pieces": "scene sensor visibility",
    "regions": "scene",
    "mapper": "scene sensor clusters coincident crops culling points renderer surface views"
    " visibility",
    "swarm": "box swarm_options",
    "schema": "camera complaints expressions layout objective search_options sensor swarm_options"
    " units values visibility",
    "lengths": "schema",
    "overrides": "complaints errors expressions files schema",
    "keys": "errors expressions overrides schema",
    "study": "errors complaints expressions files lengths meshpaths mounts notebook objective"
    " overrides pieces scene schema sensor search_options swarm_options units visibility",
    "winding": "scene welding",
    "checks": "camera mounts scene study units winding",
    "selftest": "camera scene caster clusters context culling errors points renderer surface views",
    "maps": "scene sensor caster clusters context culling mapper renderer selftest surface study"
    " views visibility",
    "evaluator": "scene sensor context visibility objective study maps",
    "worker": "maps",
    "workers": "context errors maps",
    "remote": "context errors maps",
    "cluster": "errors hints maps remote workers",
    "memory": "",
    "guess": "memory sensor study",
    "search": "auto box covariance differential errors greedy guess refine script search_options"
    " study swarm",
    "states": "complaints files search study swarm_options values",
    "checkpoint": "complaints errors evaluator files states study",
    "run": "checkpoint errors evaluator progress search study",
    "reach": "box checkpoint evaluator visibility",
    "placement": "camera checkpoint cluster context evaluator maps notebook pieces progress reach"
    " run search study visibility workers",
    "journal": "errors",
    "folder": "errors hints files journal lock",
    "indexes": "values",
    "tables": "objective pieces scene visibility",
    "within_reach": "pieces placement reach scene visibility",
    "estimate": "context evaluator pieces scene search_options sensor study search",
    "sweep": "complaints errors estimate files overrides sensor study",
    "result": "camera folder pieces placement scene study tables visibility within_reach journal",
    "reading": "context errors folder placement reach result scene study visibility complaints"
    " files indexes",
    "given_poses": "camera complaints errors files folder indexes reading rotations schema study",
    "framing": "camera",
    "normals": "",
    "shading": "camera context errors framing glsl normals",
    "coloring": "palette pieces places scene sensor visibility",
    "glyphs": "sensor",
    "sheet": "coloring places",
    "plots": "palette",
    "seriesplots": "palette plots",
    "stage": "camera coloring context framing glyphs palette sensor shading study visibility"
    " winding",
    "gapviews": "framing regions stage",
    "scenesheets": "camera coloring framing places sheet stage gapviews palette",
    "sensorsheets": "coloring palette places scenesheets sheet stage",
    "modelsheets": "coloring places scenesheets sheet stage visibility",
    "selection": "pieces study visibility",
    "pictures": "coloring plots scenesheets sensorsheets sheet stage study visibility modelsheets"
    " selection",
    "page": "glsl palette places",
    "mounting": "camera placement",
    "export_poses": "camera files mounting palette placement result rotations schema study",
    "export_surfaces": "coloring export_poses palette pieces placement rotations scene schema"
    " sensor",
    "report": "mounting page placement result tables within_reach",
    "delivery": "errors files export_poses export_surfaces folder hints mounting page pictures"
    " placement reading report result selection",
    "spread": "camera errors estimate folder placement sensor sweep reading",
    "series_tables": "folder overrides reading result seriesplots spread sweep journal",
    "series": "delivery errors folder placement series_tables spread study sweep complaints"
    " indexes journal lock",
    "doctor": "context result selftest",
    "terminal": "placement",
    "wording": "errors estimate pieces placement study swarm_options tables terminal visibility"
    " within_reach checks winding",
    "explain": "placement scene sensor study visibility",
    "explain_words": "explain mounting placement tables terminal regions",
    "tolerance": "errors evaluator mounting pieces placement schema visibility",
    "tolerance_words": "mounting pieces placement terminal tolerance",
    "series_words": "hints series_tables spread sweep terminal",
    "compare": "camera coloring palette pieces placement scene scenesheets schema sheet stage"
    " tables terminal",
    "starter_meshes": "",
    "starter_texts": "",
    "starter_layout": "camera scene schema sensor starter_texts units winding",
    "starter_study": "errors scene starter_layout starter_texts units winding",
    "starter": "errors hints meshpaths starter_meshes starter_texts starter_layout starter_study "
    "units",
    "cli_options": "",
    "cli_results": "cli_options compare delivery errors explain_words folder placement reading"
    " terminal tolerance tolerance_words",
    "cli_series": "delivery errors hints placement series series_tables series_words study sweep"
    " terminal folder",
    "cli": "checks cli_options cli_results cli_series complaints delivery doctor errors estimate"
    " files folder given_poses keys placement reach reading starter study terminal wording workers"
    " starter_study streams",
    "__main__": "cli",
    # the public names
    "__init__": "errors scene sensor study visibility evaluator placement reading result",
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
    "typer": "cli cli_options cli_results cli_series",
    "distributed": "cluster remote",
    "cma": "covariance",
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

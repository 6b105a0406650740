"""A command killed before any change of the file system goes on to the files of an unbroken one."""

import json
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.kills import Folder, told, watched
from support.two_cubes import SMALL, write_two_cubes

from glvis.cli.app import main
from glvis.errors import StudyError
from glvis.pictures.writing import write_views
from glvis.results.folder import ResultFolder, can_resume, own_folder, series_index, settle_folder
from glvis.search.swarm import Swarm

TEXT = SMALL.replace('"cube.off", "small.off"', '"cube.off"')
TEXT = TEXT.replace("iterations = 2", "iterations = 1")
SHORT = ("--set", "swarm.iterations=0")


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study").mkdir()
    return write_two_cubes(tmp_path / "study", TEXT)


@pytest.fixture(autouse=True)
def timeless(monkeypatch):
    """Let no file tell the time, nor anything that is slow to find out or to draw."""
    for module in ("placement", "run"):
        monkeypatch.setattr(f"glvis.search.{module}.time", SimpleNamespace(monotonic=lambda: 0.0))
    for function in (Swarm.__init__, Swarm.from_state.__func__):
        monkeypatch.setitem(function.__kwdefaults__, "clock", lambda: 0.0)
    stopped = SimpleNamespace(gmtime=lambda: None, strftime=lambda form, when: "then")
    monkeypatch.setattr("glvis.results.result.time", stopped)
    for module in ("results.result", "reports.report", "reports.series_tables"):
        monkeypatch.setattr(f"glvis.{module}.versions", lambda: {"glvis": "1"})
    monkeypatch.setattr("glvis.cli.study_commands._warnings", lambda study: [])
    for plot in (
        "reports.series_tables.write_repeats",
        "reports.series_tables.write_vary",
        "pictures.writing.write_convergence",
    ):
        monkeypatch.setattr(
            f"glvis.{plot}", lambda path, what, **options: path.write_text(repr(what))
        )
    monkeypatch.setattr(
        "glvis.reports.delivery.write_views",
        lambda *arguments, **options: write_views(
            *arguments, **options | {"size": (200, 200), "color": "unseen"}
        ),
    )


def run(*words, pictures=False):
    more = [] if words[0] != "optimize" else ["--workers", "1"]
    more += [] if pictures or words[0] == "render" else ["--no-pictures", "--no-meshes"]
    return main([str(word) for word in (*words, *more)])


class Kills:
    """The states that kills leave of one command, and what becomes of them."""

    def __init__(self, out):
        self.out, self.folder = out, Folder(out)
        self.states = []

    def content(self):
        return told(self.folder.state())

    def of(self, *words, **options):
        """Run a command and keep each state; return what an unbroken one leaves."""
        with watched(self.folder) as watch:
            assert run(*words, **options) == 0
        self.states = watch.states
        return self.content()

    def gone_on_from(self, opened, *commands, **options):
        """Yield for each state what a command leaves, the next one where the first is refused.

        A command depends on nothing but the folder as it is once it is opened: of states that
        are opened to the same, the first is gone on from.
        """
        known = []
        for name, state in self.states:
            self.folder.put(state)
            with suppress(StudyError):
                opened(self.out)
            begin = self.folder.state()
            end = next((end for first, end in known if first == begin), None)
            if end is None:
                self.folder.put(state)
                codes = []
                while 0 not in codes and len(codes) < len(commands):
                    codes.append(run(*commands[len(codes)], **options))
                assert codes[-1] == 0, f"killed before {name}"
                end = self.content()
                known.append((begin, end))
            yield name, end
        assert len(known) < len(self.states)


def assert_all(found, whole):
    for name, content in found:
        assert not differing(content, whole), f"killed before {name}"


def assert_first_old_then_new(found, old, new):
    """Check that what a kill leaves becomes the old result up to some moment, then the new one."""
    is_new = False
    for name, content in found:
        if is_new or content != old:
            assert not differing(content, new), f"killed before {name}"
            is_new = True
    assert is_new


def differing(one, other):
    return sorted(name for name in {*one, *other} if one.get(name) != other.get(name))


def resumed(out):
    if out.exists():
        with own_folder(out):
            ResultFolder(out, resume=True)


def overwritten(out):
    if out.exists():
        with own_folder(out):
            ResultFolder(out, overwrite=True)


def series_resumed(out):
    settle_folder(out)
    for path in sorted(out.glob("run-*")) if series_index(out) else ():
        settle_folder(path)
        with suppress(StudyError), own_folder(path):
            ResultFolder(path, resume=can_resume(path))


def test_optimize(study, tmp_path):
    kills = Kills(tmp_path / "out")
    words, resume = ("optimize", study, "-o", kills.out), ("optimize", "--resume", kills.out)
    whole = kills.of(*words, pictures=True)
    assert len(kills.states) > 120 and "views/cube-unseen.png" in whole
    assert_all(kills.gone_on_from(resumed, resume, words, pictures=True), whole)
    assert_all(kills.gone_on_from(overwritten, (*words, "--overwrite"), pictures=True), whole)


def test_pictures_that_were_begun_are_gone_where_a_resume_makes_none(study, tmp_path):
    kills = Kills(tmp_path / "out")
    words, resume = ("optimize", study, "-o", kills.out), ("optimize", "--resume", kills.out)
    assert run(*words) == 0
    bare = kills.content()
    assert "views" not in bare
    kills.folder.put({})
    kills.of(*words, pictures=True)
    kills.states = [one for one in kills.states if "unfinished/views" in one[1]]
    assert len(kills.states) > 20
    assert_all(kills.gone_on_from(resumed, resume), bare)


def test_overwrite(study, tmp_path):
    kills = Kills(tmp_path / "out")
    words, resume = ("optimize", study, "-o", kills.out), ("optimize", "--resume", kills.out)
    assert run(*words, pictures=True) == 0
    (kills.out / "notes.txt").write_text("mine")
    before = kills.folder.state()
    assert run(*resume) == 0  # a result that ended is made again, without pictures as asked
    old = kills.content()
    kills.folder.put(before)
    words = (*words, "--seed", "9", "--overwrite")
    new = kills.of(*words)
    assert new["notes.txt"] == b"mine" and "views" in before and "views" not in new
    assert_first_old_then_new(kills.gone_on_from(resumed, resume), old, new)
    assert_all(kills.gone_on_from(overwritten, words), new)


def test_extension(study, tmp_path):
    kills = Kills(tmp_path / "out")
    assert run("optimize", study, "-o", kills.out) == 0
    resume = ("optimize", "--resume", kills.out)
    old, new = kills.content(), kills.of(*resume, "--extend", "1")
    assert_first_old_then_new(kills.gone_on_from(resumed, resume), old, new)


def test_evaluate(study, tmp_path):
    kills = Kills(tmp_path / "out")
    words = ("evaluate", study, "-o", kills.out)
    whole = kills.of(*words)
    assert_all(kills.gone_on_from(overwritten, (*words, "--overwrite")), whole)


@pytest.mark.parametrize("color", [None, "unseen"])
def test_render(study, tmp_path, color):
    kills = Kills(tmp_path / "out")
    words = ("render", kills.out, *(["--color", color] if color else []))
    assert run("evaluate", study, "-o", kills.out, pictures=color is None) == 0
    whole = kills.of(*words)
    assert_all(kills.gone_on_from(settle_folder, words), whole)


def test_series(study, tmp_path):
    kills = Kills(tmp_path / "out")
    words = ("optimize", study, "-o", kills.out, *SHORT, "--repeats", "2")
    whole = kills.of(*words)
    resume = ("optimize", "--resume", kills.out)
    assert_all(kills.gone_on_from(series_resumed, resume, words), whole)


def test_overwritten_series(study, tmp_path):
    kills = Kills(tmp_path / "out")
    words = ("optimize", study, "-o", kills.out, *SHORT)
    assert run(*words, "--repeats", "2") == 0
    old, new = kills.content(), kills.of(*words, "--vary", "mounts=1,2", "--overwrite")
    resume = ("optimize", "--resume", kills.out)
    assert_first_old_then_new(kills.gone_on_from(series_resumed, resume), old, new)


SCRIPT = (
    "import sys\nfrom pathlib import Path\nsys.path.append(sys.argv[1])\n"
    "from support.kills import die_at\nfrom glvis.cli.app import main\n"
    "die_at(Path(sys.argv[2]), int(sys.argv[3]))\nsys.exit(main(sys.argv[4:]))\n"
)


def same_for_all(folder):
    """Return what must be the same however often a run was killed: all but times."""
    state = Folder(folder).state()
    index = json.loads(state["result.json"])
    state["result.json"] = {key: index[key] for key in index if key != "run"}
    rows = state["trace.csv"].decode().splitlines()
    state["trace.csv"] = [row.rpartition(",")[0] for row in rows]
    return state | dict.fromkeys(("checkpoint.npz", "report.html"))


def test_processes_that_are_killed_go_on(study, tmp_path, request, monkeypatch):
    monkeypatch.undo()
    tests, out, whole = Path(__file__).parent, tmp_path / "out", tmp_path / "whole"
    is_thorough = request.config.getoption("--all-kills")
    step, number = (1, 0) if is_thorough else (27, 4)
    words = ["--workers", "1", *([] if is_thorough else ["--no-meshes", "--no-pictures"])]
    assert main(["optimize", str(study), "-o", str(whole), *words]) == 0
    expected = same_for_all(whole)
    while True:
        command = [sys.executable, "-c", SCRIPT, tests, out, number]
        command += ["optimize", study, "-o", out, *words]
        code = subprocess.run([str(word) for word in command], cwd=tests.parent).returncode
        if code == 0:
            break
        assert code == -signal.SIGKILL
        codes = [main(["optimize", "--resume", str(out), *words])]
        if codes == [2]:
            codes = [main(["optimize", str(study), "-o", str(out), *words])]
        assert codes == [0]
        assert not differing(same_for_all(out), expected), f"killed at change {number}"
        shutil.rmtree(out)
        number += step
    assert number > 2 * step

import sys
"""A command killed before any change of the file system goes on to the files of an unbroken one."""

import shutil
from contextlib import suppress
from types import SimpleNamespace

import pytest
from kills import contents, watched
from studies import SMALL, write_small_study

from glvis.cli import main
from glvis.drawing.pictures import write_views
from glvis.errors import StudyError
from glvis.optim.swarm import Swarm
from glvis.outputs.folder import ResultFolder, can_resume, own_folder, series_index, settle_folder

# Few files, and no time in any of them
TEXT = SMALL.replace('"cube.off", "small.off"', '"cube.off"')
TEXT = TEXT.replace("iterations = 2", "iterations = 1")


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study").mkdir()
    return write_small_study(tmp_path / "study", TEXT)


@pytest.fixture(autouse=True)
def timeless(monkeypatch):
    for module in ("placement", "run"):
        monkeypatch.setattr(f"glvis.optim.{module}.time", SimpleNamespace(monotonic=lambda: 0.0))
    for function in (Swarm.__init__, Swarm.from_state.__func__):
        monkeypatch.setitem(function.__kwdefaults__, "clock", lambda: 0.0)
    stopped = SimpleNamespace(gmtime=lambda: None, strftime=lambda form, when: "then")
    monkeypatch.setattr("glvis.outputs.result.time", stopped)
    versions = {"glvis": "1"}  # slow to read
    monkeypatch.setattr("glvis.outputs.result.versions", lambda: versions)
    monkeypatch.setattr("glvis.outputs.series_tables.versions", lambda: versions)
    monkeypatch.setattr("glvis.cli._warnings", lambda study: [])

    def small(*arguments, **options):
        return write_views(*arguments, **options | {"size": (200, 200)})

    monkeypatch.setattr("glvis.outputs.delivery.write_views", small)


def run(*words, pictures=False):
    more = [] if words[0] != "optimize" else ["--workers", "1"]
    more += [] if pictures or words[0] == "render" else ["--no-pictures"]
    return main([str(word) for word in (*words, *more)])


class Kills:
    """States that kills left of one command, and what becomes of them."""

    def __init__(self, tmp_path, name="out"):
        self.out, self.kept = tmp_path / name, tmp_path / f"kept-{name}"
        self.kept.mkdir()
        self.names = []

    def of(self, *words, **options):
        """Run a command and keep each state; return what an unbroken one leaves."""
        with watched(self.out, self.kept) as watch:
            assert run(*words, **options) == 0
        self.names = watch.names
        return contents(self.out)

    def gone_on_from(self, opened, *commands, **options):
        """Yield for each state what a command leaves, the next one where the first is refused.

        A command depends on nothing but the folder as it is once it is opened: of states that
        are opened to the same, the first is gone on from.
        """
        known = {}
        for number, name in enumerate(self.names):
            state = self.kept / str(number)
            self._put(state)
            with suppress(StudyError):
                opened(self.out)
            key = repr(sorted(contents(self.out).items())) if self.out.exists() else ""
            if key not in known:
                self._put(state)
                for words in commands:
                    code = run(*words, **options)
                    if code == 0:
                        break
                assert code == 0, f"{name}: {words} ends with {code}"
                known[key] = contents(self.out)
            yield name, known[key]
        print("COUNT", len(self.names), len(known), file=sys.__stderr__)
        assert len(known) < len(self.names)

    def _put(self, state):
        shutil.rmtree(self.out, ignore_errors=True)
        if state.exists():
            shutil.copytree(state, self.out)


def resumed(out):
    if out.exists():
        with own_folder(out):
            ResultFolder(out, resume=True)


def overwritten(out):
    if out.exists():
        with own_folder(out):
            ResultFolder(out, overwrite=True)


def rendered(out):
    settle_folder(out)
    shutil.rmtree(out / "unfinished-files", ignore_errors=True)
    (out / "unfinished.lock").unlink(missing_ok=True)


def series_resumed(out):
    settle_folder(out)
    if series_index(out) is None:
        return rendered(out)
    for path in sorted(out.glob("run-*")):
        settle_folder(path)
        with suppress(StudyError), own_folder(path):
            ResultFolder(path, resume=can_resume(path))
    return None


def differing(one, other):
    return sorted(name for name in {*one, *other} if one.get(name) != other.get(name))


def check_first_old_then_new(found, old, new):
    """Check that what a kill leaves becomes the old result up to some moment, then the new one."""
    is_new = False
    for name, content in found:
        if is_new or content != old:
            assert not differing(content, new), f"killed before {name}"
            is_new = True
    assert is_new


@pytest.mark.parametrize("pictures", [False, True])
def test_optimize(study, tmp_path, pictures):
    kills, words = Kills(tmp_path), ("optimize", study, "-o", tmp_path / "out")
    whole = kills.of(*words, pictures=pictures)
    assert len(kills.names) > (150 if pictures else 80)
    again = ("optimize", "--resume", kills.out), words
    for name, content in kills.gone_on_from(resumed, *again, pictures=pictures):
        assert not differing(content, whole), f"killed before {name}"
    again = ((*words, "--overwrite"),)
    for name, content in kills.gone_on_from(overwritten, *again, pictures=pictures):
        assert not differing(content, whole), f"killed before {name}"


def test_overwrite(study, tmp_path):
    kills, words = Kills(tmp_path), ("optimize", study, "-o", tmp_path / "out")
    resume = ("optimize", "--resume", kills.out)
    assert run(*words, pictures=True) == 0
    (kills.out / "notes.txt").write_text("mine")
    shutil.copytree(kills.out, tmp_path / "before")
    assert run(*resume) == 0  # a result that ended is made again, without pictures as asked
    old = contents(kills.out)
    shutil.rmtree(kills.out)
    (tmp_path / "before").rename(kills.out)
    words = (*words, "--seed", "9", "--overwrite")
    new = kills.of(*words)
    assert new["notes.txt"] == b"mine" and "views" not in new
    check_first_old_then_new(kills.gone_on_from(resumed, resume), old, new)
    for name, content in kills.gone_on_from(overwritten, words):
        assert not differing(content, new), f"killed before {name}"


def test_extension_of_what_was_killed_or_ended(study, tmp_path):
    kills, words = Kills(tmp_path), ("optimize", study, "-o", tmp_path / "out")
    old = (run(*words), contents(kills.out))[1]
    new = kills.of("optimize", "--resume", kills.out, "--extend", "1")
    found = kills.gone_on_from(resumed, ("optimize", "--resume", kills.out))
    check_first_old_then_new(found, old, new)


def test_evaluate(study, tmp_path):
    kills, words = Kills(tmp_path), ("evaluate", study, "-o", tmp_path / "out")
    whole = kills.of(*words)
    for name, content in kills.gone_on_from(overwritten, (*words, "--overwrite")):
        assert not differing(content, whole), f"killed before {name}"


@pytest.mark.parametrize("color", [None, "unseen"])
def test_render(study, tmp_path, color):
    kills = Kills(tmp_path)
    words = ("render", kills.out, *(["--color", color] if color else []))
    assert run("evaluate", study, "-o", kills.out, pictures=color is None) == 0
    whole = kills.of(*words)
    for name, content in kills.gone_on_from(rendered, words):
        assert not differing(content, whole), f"killed before {name}"


def test_series(study, tmp_path):
    kills, words = Kills(tmp_path), ("optimize", study, "-o", tmp_path / "out", "--repeats", "2")
    whole = kills.of(*words)
    again = ("optimize", "--resume", kills.out), words
    for name, content in kills.gone_on_from(series_resumed, *again):
        assert not differing(content, whole), f"killed before {name}"


def test_overwritten_series(study, tmp_path):
    kills, words = Kills(tmp_path), ("optimize", study, "-o", tmp_path / "out")
    assert run(*words, "--repeats", "2") == 0
    words = (*words, "--sweep", "mounts=1,2", "--overwrite")
    old, new = contents(kills.out), kills.of(*words)
    found = kills.gone_on_from(series_resumed, ("optimize", "--resume", kills.out))
    check_first_old_then_new(found, old, new)

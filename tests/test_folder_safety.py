"""One process at a time in a folder, no way out of it, and nothing lost where a commit fails."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.two_cubes import write_two_cubes

import glvis
from glvis.cli.app import main
from glvis.errors import MachineError, StudyError
from glvis.results.folder import ResultFolder, read_index, result_folder
from glvis.results.journal import JOURNAL, files_below
from glvis.results.lock import LOCK, held

ROOT = str(Path(glvis.__file__).parents[1])
BUSY = "another glvis is at work in this folder; wait until it has ended or choose another folder"


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study").mkdir()
    return write_two_cubes(tmp_path / "study")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A search and a series, ended, without pictures."""
    folder = tmp_path_factory.mktemp("results")
    study = write_two_cubes(folder)
    for name, more in (("one", []), ("many", ["--repeats", "1"])):
        assert run("optimize", study, "-o", folder / name, *more) == 0
    return folder


@pytest.fixture
def one(results, tmp_path):
    return Path(shutil.copytree(results / "one", tmp_path / "one"))


@pytest.fixture
def many(results, tmp_path):
    return Path(shutil.copytree(results / "many", tmp_path / "many"))


def run(*words):
    quick = {"optimize": ["--workers", "1", "--no-pictures"], "evaluate": ["--no-pictures"]}
    return main([str(word) for word in (*words, *quick.get(words[0], []))])


def contents(folder):
    return {name: (folder / name).read_bytes() for name in files_below(folder)}


def holder(folder):
    """Start a process that is at work in a folder."""
    script = (
        "import sys, time\nfrom pathlib import Path\nfrom glvis.results.lock import held\n"
        "with held(Path(sys.argv[1])):\n    print('here', flush=True)\n    time.sleep(600)\n"
    )
    command = [sys.executable, "-c", script, str(folder)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "here\n"
    return process


def test_second_process_in_a_folder_is_told_and_a_killed_one_holds_nothing(
    one, many, study, capsys
):
    commands = [
        (one, "optimize", "--resume", one),
        (one, "optimize", study, "-o", one, "--overwrite"),
        (one, "evaluate", study, "-o", one, "--overwrite"),
        (one, "render", one),
        (many, "optimize", "--resume", many),
        (many, "optimize", study, "-o", many, "--repeats", "1", "--overwrite"),
    ]
    processes = [holder(folder) for folder in (one, many)]
    try:
        before = contents(one), contents(many)
        capsys.readouterr()
        for folder, *words in commands:
            assert run(*words) == 2
            assert capsys.readouterr().err == f"error: {folder}: {BUSY}\n"
        assert (contents(one), contents(many)) == before
    finally:
        for process in processes:
            process.kill()
            process.wait()
            process.stdout.close()
    assert (one / LOCK).exists()
    for _, *words in commands[1:]:
        assert run(*words, *(["--color", "unseen"] if words[0] == "render" else [])) == 0
    assert not list(one.parent.rglob("unfinished*"))


def test_run_of_a_series_that_somebody_is_at_is_not_overwritten(many, study, capsys):
    before = contents(many)
    with held(many / "run-01"):
        capsys.readouterr()
        words = ("optimize", study, "-o", many, "--repeats", "1", "--overwrite")
        assert run(*words) == 2
        assert capsys.readouterr().err == f"error: {many / 'run-01'}: {BUSY}\n"
    assert contents(many) == before


def test_two_in_one_process_are_told_apart_too(tmp_path):
    with held(tmp_path):
        for _ in range(2):
            with pytest.raises(StudyError, match=BUSY), held(tmp_path):
                pass
        assert files_below(tmp_path) == [LOCK]
    assert files_below(tmp_path) == []


def test_drive_that_cannot_lock_is_worked_on_without(tmp_path, monkeypatch):
    monkeypatch.setattr("glvis.results.lock._connected", lambda lock: (None, True))
    with held(tmp_path):
        pass
    monkeypatch.setitem(sys.modules, "sqlite3", None)
    with held(tmp_path):
        pass


def test_lock_that_was_removed_meanwhile_is_not_taken_for_held(tmp_path, monkeypatch):
    from glvis.results import lock

    connected, tries = lock._connected, []

    def late(path):
        found = connected(path)
        if not tries:
            path.unlink()  # by the process that had it before
        tries.append(path)
        return found

    monkeypatch.setattr("glvis.results.lock._connected", late)
    with held(tmp_path):
        assert len(tries) == 2 and files_below(tmp_path) == [LOCK]


def linked(folder, name, tmp_path):
    """Put a link in a result folder to one of somebody's own; return that one."""
    home = tmp_path / "home"
    home.mkdir()
    for own in ("a", "study.toml", "checkpoint.npz", JOURNAL):
        (home / own).write_text("mine")
    if (folder / name).exists():
        shutil.rmtree(folder / name)
    (folder / name).symlink_to(home, target_is_directory=True)
    return home


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("deep", ("optimize", "STUDY", "-o", "ONE", "--overwrite")),
        ("unfinished", ("optimize", "--resume", "ONE")),
        ("unfinished", ("optimize", "STUDY", "-o", "ONE", "--overwrite")),
        ("unfinished-files", ("render", "ONE")),
        ("unfinished-files", ("optimize", "--resume", "ONE")),
        ("views", ("render", "ONE")),
        ("views", ("evaluate", "STUDY", "-o", "ONE", "--overwrite")),
        ("exports", ("evaluate", "STUDY", "-o", "ONE", "--overwrite")),
        ("exports", ("optimize", "--resume", "ONE")),
    ],
)
def test_links_in_a_result_are_not_followed(one, study, tmp_path, capsys, name, words):
    home = linked(one, name, tmp_path)
    if name == "deep":
        index = read_index(one / "result.json")
        index["files"].append("deep/a")
        (one / "result.json").write_text(json.dumps(index))
    before = contents(home), contents(one)
    capsys.readouterr()
    places = {"ONE": one, "STUDY": study}
    assert run(*(places.get(word, word) for word in words)) == 2
    fact = "is a symbolic link; inside a result none is followed; remove it"
    assert capsys.readouterr().err == f"error: {one / name}: {fact}\n"
    assert (contents(home), contents(one)) == before
    assert (one / name).is_symlink()


@pytest.mark.parametrize("name", ["run-01", "run-02", "unfinished-files"])
def test_links_in_a_series_are_not_followed(many, study, tmp_path, capsys, name):
    home = linked(many, name, tmp_path)
    before = contents(home)
    for words in (
        ("optimize", study, "-o", many, "--repeats", "1", "--overwrite"),
        ("optimize", "--resume", many, "--repeats", "2"),
    ):
        assert run(*words) == 2
        assert f"error: {many / name}: is a symbolic link" in capsys.readouterr().err
    assert contents(home) == before


@pytest.mark.parametrize(
    "name", ["checkpoint.npz", "study.toml", "checkpoint.npz.part", "study.toml.part"]
)
def test_links_to_files_are_not_written_through(study, tmp_path, name):
    out, own = tmp_path / "out", tmp_path / "own.txt"
    with pytest.raises(MachineError), result_folder(out) as folder:
        folder.keep_study("study")
        folder.checkpoint.write_bytes(b"state")
        raise MachineError("killed")
    own.write_text("mine")
    (out / "unfinished" / name).unlink(missing_ok=True)
    (out / "unfinished" / name).symlink_to(own)
    assert run("optimize", "--resume", out) == 2
    assert run("optimize", study, "-o", out, "--overwrite") == 0
    assert own.read_text() == "mine"


def test_link_in_place_of_the_lock_or_of_a_table_is_not_followed(many, study, tmp_path, capsys):
    own = tmp_path / "own.txt"
    own.write_text("mine")
    for name in ("repeats.csv.part", "repeats.png", "repeats.png.part", "repeats.json.part"):
        (many / name).unlink(missing_ok=True)
        (many / name).symlink_to(own)
    assert run("optimize", "--resume", many, "--repeats", "2") == 0
    assert own.read_text() == "mine" and not (many / "repeats.png").is_symlink()
    (many / LOCK).symlink_to(own)
    capsys.readouterr()
    assert run("optimize", "--resume", many) == 2
    assert f"error: {many / LOCK}: is a symbolic link" in capsys.readouterr().err


@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), KeyboardInterrupt()])
def test_error_while_files_are_put_in_place_loses_none(study, tmp_path, monkeypatch, error):
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert run("optimize", study, "-o", whole) == 0
    replace, done = Path.replace, []

    def fail(self, target):
        if not self.name.endswith(".part"):
            done.append(target)
            if len(done) == 5:
                raise error
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fail)
    code = run("optimize", study, "-o", out)
    assert code == (130 if isinstance(error, KeyboardInterrupt) else 1)
    monkeypatch.undo()
    names = {name.removeprefix("unfinished/") for name in files_below(out)} - {JOURNAL}
    assert names == {*files_below(whole)}
    shutil.copytree(out, tmp_path / "other")
    assert run("optimize", "--resume", out) == 0
    assert files_below(out) == files_below(whole)
    out = tmp_path / "other"
    assert run("optimize", study, "-o", out, "--overwrite") == 0
    assert files_below(out) == files_below(whole)


def test_what_stands_in_the_way_gets_another_name(study, tmp_path):
    out = tmp_path / "out"
    with result_folder(out) as folder:
        (out / "exports").write_text("mine")
        (out / "a.csv").mkdir()
        (out / "a.csv.kept").write_text("mine, too")
        (folder.staging / "exports").mkdir()
        for name in ("a.csv", "exports/b.csv"):
            (folder.staging / name).write_text("new")
    assert contents(out) == {
        "a.csv": b"new",
        "a.csv.kept": b"mine, too",
        "exports/b.csv": b"new",
        "exports.kept": b"mine",
    }
    assert (out / "a.csv.kept-2").is_dir()


def test_error_in_the_commit_says_that_nothing_is_lost(tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("glvis.results.journal._put", full)
    fact = "No space left on device; the result is whole: what writes into .*out next puts the rest"
    with pytest.raises(MachineError, match=fact), result_folder(tmp_path / "out") as folder:
        (folder.staging / "a").touch()
    assert files_below(tmp_path / "out") == ["unfinished/a", f"unfinished/{JOURNAL}"]
    monkeypatch.undo()
    with pytest.raises(StudyError, match=r"is not empty and holds no result of glvis \(a\)"):
        ResultFolder(tmp_path / "out")


def test_link_that_comes_while_a_run_is_on_is_not_followed(tmp_path):
    out, home = tmp_path / "out", tmp_path / "home"
    home.mkdir()
    with pytest.raises(StudyError, match="views: is a symbolic link"), result_folder(out) as folder:
        (folder.staging / "views").mkdir()
        (folder.staging / "views" / "a.png").touch()
        (out / "views").symlink_to(home)
    assert not list(home.iterdir())


@pytest.mark.parametrize(
    "text",
    [
        "no json",
        "[]",
        '{"new": ["../a"], "old": [], "last": [], "renews": false}',
        '{"new": [], "old": ["/a"], "last": [], "renews": false}',
        '{"new": [], "old": [], "last": [], "renews": 1}',
        '{"new": "a", "old": [], "last": [], "renews": true}',
    ],
)
def test_journal_that_is_none_is_one_line(tmp_path, text):
    (tmp_path / "a").touch()
    (tmp_path / "out" / "unfinished").mkdir(parents=True)
    (tmp_path / "out" / "unfinished" / JOURNAL).write_text(text)
    with pytest.raises(
        StudyError, match=r"journal\.json: is no journal of glvis; remove .*shed to"
    ):
        ResultFolder(tmp_path / "out", overwrite=True)
    assert files_below(tmp_path) == ["a", f"out/unfinished/{JOURNAL}"]


def test_who_reads_a_folder_that_was_cut_off_is_told_what_goes_on(one, tmp_path):
    (one / "result.json").unlink()
    (one / "unfinished").mkdir()
    (one / "unfinished" / JOURNAL).touch()
    with pytest.raises(StudyError, match="a run was killed while it put its files in place, and"):
        read_index(one / "result.json")
    (one / "unfinished" / JOURNAL).rename(one / "unfinished" / "checkpoint.npz")
    with pytest.raises(StudyError, match="a search was cut off there: glvis optimize --resume"):
        read_index(one / "result.json")


def test_series_takes_the_folder_of_a_search_that_was_killed_before_it_began(study, tmp_path):
    out = tmp_path / "out"
    (out / "unfinished").mkdir(parents=True)
    (out / "unfinished" / "study.toml").touch()
    assert run("optimize", study, "-o", out, "--repeats", "1") == 0
    assert not list(out.rglob("unfinished*"))


def test_folder_whose_name_is_too_long_is_one_line(study, tmp_path, capsys):
    long = tmp_path / ("x" * 5000)
    for words in (("optimize", "--resume", long), ("optimize", study, "-o", long)):
        assert run(*words) == 1
        error = capsys.readouterr().err
        assert error.startswith(f"error: {str(tmp_path)[:20]}")
        assert error.endswith("x: cannot be written to: File name too long\n") and len(error) < 500


def test_search_killed_before_its_first_iteration_begins_anew(study, one, tmp_path, capsys):
    out = tmp_path / "out"
    with pytest.raises(MachineError), result_folder(out) as folder:
        folder.checkpoint.touch()
        raise MachineError("killed")
    (out / "unfinished" / "checkpoint.npz").rename(out / "unfinished" / "study.toml")
    (out / "unfinished" / "study.toml").write_text(glvis.load_study(study).text)
    assert run("optimize", "--resume", out, "--extend", "2") == 2
    assert "its search was killed before it began; there is nothing to --extend" in (
        capsys.readouterr().err
    )
    assert run("optimize", "--resume", out) == 0
    index = json.loads((out / "result.json").read_text())
    assert index["search"]["stop_reason"] == "finished: all 2 iterations done"

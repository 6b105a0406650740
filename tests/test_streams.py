"""Output that cannot be written, and signals, end no run with a traceback or without its result."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import moderngl
import pytest
from support.two_cubes import SMALL, write_two_cubes

import glvis
from glvis.cli.app import main
from glvis.cli.streams import Patient
from glvis.results.reading import read_result

FULL = Path("/dev/full")
ROOT = str(Path(glvis.__file__).parents[1])
GLVIS = [sys.executable, "-m", "glvis"]
QUICK = ["--no-pictures", "--no-meshes"]

has_full = pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
has_hangup = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="this system has no SIGHUP")


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study").mkdir()
    return write_two_cubes(tmp_path / "study")


def shell(study, out, redirection):
    """Run a search by a shell, with its streams led elsewhere."""
    command = f'"$0" -m glvis optimize "$1" -o "$2" --workers 1 {" ".join(QUICK)} {redirection}'
    return subprocess.run(
        ["sh", "-c", command, sys.executable, study, out], cwd=ROOT, capture_output=True, text=True
    )


@has_full
@pytest.mark.parametrize(
    ("redirection", "code", "out", "error"),
    [
        ("2>/dev/full", 0, "Result: ", ""),
        (">/dev/full", 1, "", "error: standard output cannot be written to: No space left on dev"),
        (">&-", 0, "", "iteration 2/2"),
        ("2>&-", 0, "Result: ", ""),
        (">&- 2>&-", 0, "", ""),
    ],
)
def test_streams_that_take_nothing_cost_no_result(study, tmp_path, redirection, code, out, error):
    done = shell(study, tmp_path / "out", redirection)
    assert done.returncode == code, done.stderr
    assert out in done.stdout and error in done.stderr and "Traceback" not in done.stderr
    assert read_result(tmp_path / "out").stop_reason == "finished: all 2 iterations done"
    assert not list((tmp_path / "out").glob("unfinished*"))


@has_full
def test_what_only_speaks_fails_where_it_cannot(study):
    for words in (["check", str(study)], ["--help"]):
        with FULL.open("w") as full:
            done = subprocess.run(
                [*GLVIS, *words], cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True
            )
        assert done.returncode == 1
        assert done.stderr == (
            "error: standard output cannot be written to: No space left on device\n"
        )


def test_a_stream_goes_on_when_its_reader_has_gone_away():
    reader, writer = os.pipe()
    with open(writer, "w") as stream:  # noqa: PTH123
        patient = Patient(stream)
        os.close(reader)
        for _ in range(2):
            assert patient.write("word\n") == 5
            patient.flush()
        assert patient.error is None and patient.fileno() == writer


ENDLESS = SMALL.replace("iterations = 2", "iterations = 1000000\nstall_iterations = 1000000")


@has_hangup
@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_terminal_that_is_closed_ends_a_search_well(study, tmp_path, workers):
    study.write_text(ENDLESS)
    reader, writer = os.openpty()
    command = [*GLVIS, "optimize", study, "-o", tmp_path / "out", "--workers", workers, *QUICK]
    process = subprocess.Popen(
        command, cwd=ROOT, stdin=writer, stdout=writer, stderr=writer, start_new_session=True
    )
    os.close(writer)
    shown = b""
    while b"best" not in shown:
        shown += os.read(reader, 4096)
    os.killpg(process.pid, signal.SIGHUP)  # as the system does for all that the terminal started
    os.close(reader)
    try:
        process.wait(timeout=120)
    finally:
        process.kill()
    found = read_result(tmp_path / "out")
    assert found.stop_reason == "interrupted: SIGHUP" and found.warnings == ()
    assert not list((tmp_path / "out").glob("unfinished*"))


@pytest.mark.parametrize("name", ["SIGINT", "SIGHUP"])
def test_signals_outside_of_a_search_are_one_line(study, tmp_path, name, monkeypatch, capsys):
    number = getattr(signal, name, None)
    if number is None:
        pytest.skip(f"this system has no {name}")
    before = [signal.getsignal(one) for one in (signal.SIGINT, number)]
    monkeypatch.setattr(
        "glvis.search.placement.evaluate_poses", lambda *args: os.kill(os.getpid(), number)
    )
    assert main(["evaluate", str(study), "-o", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().err == "error: interrupted\n"
    assert not (tmp_path / "out").exists()
    assert [signal.getsignal(one) for one in (signal.SIGINT, number)] == before


def test_ctrl_c_while_glvis_is_loaded_is_one_line():
    script = (
        "import os, signal, sys\n"
        "class Interrupts:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'typer':\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "sys.meta_path.insert(0, Interrupts())\n"
        "sys.argv[1:] = ['--version']\n"
        "from glvis.__main__ import main\n"
        "sys.exit(main())\n"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: interrupted\n")


def test_what_the_driver_refuses_is_one_line(study, tmp_path, monkeypatch, capsys):
    def fail(*arguments):
        raise moderngl.Error("cannot map the buffer")

    monkeypatch.setattr("glvis.search.placement.evaluate_poses", fail)
    assert main(["evaluate", str(study), "-o", str(tmp_path / "out")]) == 1
    assert capsys.readouterr().err == (
        "error: OpenGL ended it: cannot map the buffer; "
        "most often this machine has too little memory for the study\n"
    )


@pytest.mark.parametrize(
    ("error", "is_told"),
    [
        (MemoryError(), True),
        (ImportError("scipy/x.so: failed to map segment from shared object"), True),
        (ImportError("libx.so: cannot allocate memory in static TLS block"), True),
        (ImportError("No module named 'x'"), False),
    ],
)
def test_too_little_memory_is_one_line(study, tmp_path, monkeypatch, capsys, error, is_told):
    def fail(*arguments):
        raise error

    monkeypatch.setattr("glvis.search.placement.evaluate_poses", fail)
    words = ["evaluate", str(study), "-o", str(tmp_path / "out")]
    if is_told:
        assert main(words) == 1
        assert (
            capsys.readouterr().err == "error: this machine has too little memory for the study\n"
        )
    else:
        with pytest.raises(ImportError, match="No module"):
            main(words)
    assert not (tmp_path / "out").exists()

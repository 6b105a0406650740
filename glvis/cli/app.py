"""The command line: reads what the user wants, hands it on, and says what came of it.

Exit codes: 0, 2 for what the user wrote (``StudyError``), 1 for what the machine refused
(``MachineError``); one line on standard error, no traceback.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from glvis import __version__
from glvis.cli.manual_commands import commands as commands_about_the_manual
from glvis.cli.result_commands import commands as commands_about_results
from glvis.cli.sensor_commands import commands as commands_about_sensors
from glvis.cli.streams import ended_as_by_ctrl_c, patient_streams
from glvis.cli.study_commands import commands as commands_about_studies
from glvis.errors import MachineError, StudyError

app = typer.Typer(
    name="glvis",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
_TOO_LITTLE = "this machine has too little memory for the study"
# How Linux and the BSDs say it of libraries that they cannot load for want of memory.
_NOT_MAPPED = ("failed to map segment", "annot allocate memory")
_INTERRUPTED = 130  # as a shell says it of Ctrl-C
# All mistakes in the use of options; typer brings its own copy of click or asks for one.
_UsageError: Any = typer.BadParameter.__bases__[0]


class _Teller(logging.Handler):
    """Says what the library does that takes long, such as reading a large mesh."""

    def emit(self, record: logging.LogRecord) -> None:
        from glvis.cli.terminal import say

        say(record.getMessage(), error=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    with ended_as_by_ctrl_c(), patient_streams() as (out, _):
        code = _exit_code(arguments)
        out.flush()
        if out.error and code == 0:  # what a script would take for the whole of it
            why = out.error.strerror or str(out.error)
            return _fail(f"standard output cannot be written to: {why}", 1)
        return code


def _exit_code(arguments: Sequence[str] | None) -> int:
    """Run a command; say in one line what has ended it."""
    log = logging.getLogger("glvis")
    log.setLevel(logging.INFO)
    log.handlers = [_Teller()]
    words = list(sys.argv[1:] if arguments is None else arguments)
    if wrong := [word for word in words if not _is_text(word)]:
        from glvis.common.files import printable

        return _fail(f"{printable(wrong[0])}: is no text in UTF-8; rename what it names", 2)
    try:
        code = app(words, prog_name="glvis", standalone_mode=False)
    except StudyError as error:
        return _fail(str(error), 2)
    except MachineError as error:
        return _fail(str(error), 1)
    except OSError as error:  # a name that is too long, a folder that is gone
        return _fail(f"{error.filename or 'the system'}: {error.strerror or error}", 1)
    except MemoryError:
        return _fail(_TOO_LITTLE, 1)
    except ImportError as error:
        if not any(text in str(error) for text in _NOT_MAPPED):
            raise
        return _fail(_TOO_LITTLE, 1)
    except _UsageError as error:
        if not error.format_message():  # no command at all: its help has been printed
            return 2
        return _fail(f"{error.format_message().rstrip('.')}; {_advice(error)}", 2)
    except (KeyboardInterrupt, typer.Abort):
        code = _INTERRUPTED
    except Exception as error:
        if type(error).__module__ != "_moderngl":
            raise
        return _fail(f"OpenGL ended it: {error}; most often {_TOO_LITTLE}", 1)
    if code == _INTERRUPTED:  # typer makes it of KeyboardInterrupt, without a word
        return _fail("interrupted", code)
    return code if isinstance(code, int) else 0


def _fail(text: str, code: int) -> int:
    from glvis.common.complaints import one_line

    sys.stderr.write(f"error: {one_line(text)}\n")
    return code


def _advice(error: typer.BadParameter) -> str:
    """Return what to do about a wrong use of the command line."""
    command = error.ctx.command_path if error.ctx else "glvis"
    if command == "glvis init" and "extra argument" in error.message:  # a shell unfolded *.stl
        return "put --model before each mesh, or quotes about a pattern: --model '*.stl'"
    return f"'{command} --help' tells more"


def _is_text(word: str) -> bool:
    """Return whether an argument is whole letters: no result can hold bytes that are no UTF-8."""
    try:
        word.encode()
    except UnicodeEncodeError:
        return False
    return True


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"glvis {__version__}")
        raise typer.Exit


@app.callback(epilog="A first run:  glvis check arm.toml, then  glvis optimize arm.toml -o out/arm")
def _glvis(
    version: Annotated[
        bool,
        typer.Option(
            "-V", "--version", callback=_print_version, is_eager=True, help="Print it and exit."
        ),
    ] = False,
) -> None:
    """Find where to put cameras and depth sensors, and see what each of them sees.

    A study is one TOML file: meshes, sensors, what may move and how far, the objective.
    Lengths are in the study's unit (mm unless it says otherwise), angles in degrees.
    """


app.add_typer(commands_about_studies)
app.add_typer(commands_about_results)
app.add_typer(commands_about_sensors)
app.add_typer(commands_about_the_manual)


@app.command()
def doctor() -> None:
    """Say what this machine has of all that glvis needs, and what to install."""
    from glvis.cli.doctor import health
    from glvis.cli.terminal import say

    for line in health():
        say(line)

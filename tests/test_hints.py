"""Commands that people are told: what is pasted means what was meant."""

import shlex
import subprocess
from pathlib import Path

import pytest

from glvis.common.hints import command
from glvis.study.starter import next_commands

PATHS = [
    "plain/study.toml",
    "a clone/study.toml",
    "Prüfling ß 部品/study.toml",
    "it's/st$udy;.toml",
]


@pytest.mark.parametrize("path", PATHS)
def test_a_command_is_taken_apart_by_a_shell_as_it_was_meant(path):
    assert shlex.split(command("render", Path(path))) == ["glvis", "render", path]
    echoed = subprocess.run(
        ["sh", "-c", command("render", path).replace("glvis", "printf '%s|'", 1)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert echoed.stdout == f"render|{path}|"


def test_a_plain_path_stays_without_quotes():
    assert command("optimize", "--resume", Path("out/arm")) == "glvis optimize --resume out/arm"


def test_windows_gets_double_quotes(monkeypatch):
    monkeypatch.setattr("glvis.common.hints.os.name", "nt")
    assert command("check", "a clone\\study.toml") == 'glvis check "a clone\\study.toml"'


@pytest.mark.parametrize("path", PATHS)
def test_commands_after_init_can_be_pasted(path):
    study, out = Path(path), Path(path).parent / "out"
    assert [shlex.split(line) for line in next_commands(study)] == [
        ["glvis", "check", str(study)],
        ["glvis", "optimize", str(study), "-o", str(out)],
        ["glvis", "explain", str(out)],
    ]

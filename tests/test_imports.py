"""Who imports whom: the contracts in pyproject.toml, held by import-linter."""

from pathlib import Path

from importlinter.cli import lint_imports

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def test_folders_import_downwards_and_libraries_have_one_door(capsys):
    failed = lint_imports(config_filename=str(PYPROJECT), cache_dir=None)
    assert not failed, capsys.readouterr().out

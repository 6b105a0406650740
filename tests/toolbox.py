"""The scripts of ``tools/`` as modules, so that tests need not start a process for each."""

from __future__ import annotations

import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType

TOOLS = Path(__file__).resolve().parents[1] / "tools"


def tool(name: str) -> ModuleType:
    """Return a script, imported and not run."""
    if str(TOOLS) not in sys.path:
        sys.path.append(str(TOOLS))  # scripts import what lies beside them
    loader = SourceFileLoader(name, str(TOOLS / name))
    spec = spec_from_loader(name, loader)
    assert spec
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module

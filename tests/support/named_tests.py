"""Tests that a page names, as ``file.py::test_name``, and those that there are."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]


def cases_named(page: str) -> list[str]:
    """Return the tests that a page names, sorted."""
    return sorted(set(re.findall(r"`(\w+\.py::\w+)`", page)))


def is_there(case: str) -> bool:
    """Return whether a test of that name stands in that file."""
    file, _, name = case.partition("::")
    return name.startswith("test_") and name in _cases_in(file)


@cache
def _cases_in(file: str) -> set[str]:
    tree = ast.parse((TESTS / file).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}

"""Each fault that was found from outside has a test that is there."""

import pytest
from support.named_tests import TESTS, cases_named, is_there

PAGE = (TESTS / "faults.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("| ") and "::" in line]


@pytest.mark.parametrize("case", cases_named(PAGE))
def test_each_test_that_is_named_exists(case):
    assert is_there(case)


def test_each_fault_names_one_test():
    assert len(ROWS) > 90 and all(len(cases_named(row)) == 1 for row in ROWS)


def test_a_test_that_is_gone_would_be_noticed():
    assert not is_there("test_faults.py::test_no_such_thing")

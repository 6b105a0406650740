"""Fixtures for every test: loud floating point, a seeded generator, the shared real meshes."""

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.browser import Browser, find_chromium

from glvis.visibility.context import gl_context

# Real meshes that nobody here modelled lie beside the checkout, where there are any.
SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

# A shell lets what it starts in the background ignore Ctrl-C, and nohup the end of its terminal;
# tests here send both, and what they start inherits what is ignored.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


# Files whose tests take five seconds and more together: processes, browsers, rays, real meshes.
SLOW = {
    "any_mesh", "bad_input", "catalogue", "checkpoint", "cli", "cli_results", "cluster",
    "compare_methods", "exports", "folder_safety", "gpu_check", "hostile_files", "hostile_studies",
    "kills", "packaging", "page", "page_reading", "pictures", "pieces", "pieces_results",
    "pixel_sizes", "python", "quality_results", "reach", "reproduce", "result", "rooms", "scenes",
    "search", "selection", "series", "seriesplots", "starter", "streams", "swarm",
    "two_viewpoints", "workers",
}  # fmt: skip


def pytest_collection_modifyitems(items):
    for item in items:
        if item.path.stem.removeprefix("test_") in SLOW:
            item.add_marker(pytest.mark.slow)


def pytest_addoption(parser):
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write the golden pictures anew, to be looked at before they are committed",
    )
    parser.addoption(
        "--all-meshes",
        action="store_true",
        help="print the figures of every mesh of tests/test_any_mesh.py, not of the worst alone",
    )
    parser.addoption(
        "--all-kills",
        action="store_true",
        help="kill a process of tests/test_kills.py at each change of a file, not at a few alone",
    )
    parser.addoption(
        "--rounds",
        type=int,
        default=1,
        help="how often tests/test_any_mesh.py draws the poses of a mesh (default 1)",
    )


@pytest.fixture(autouse=True)
def _loud_floats():
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        yield


@pytest.fixture(autouse=True)
def _no_gl_error():
    """Let every test find and leave OpenGL without an error, where this process has a context."""
    _assert_no_gl_error()
    yield
    _assert_no_gl_error()


def _assert_no_gl_error():
    if gl_context.cache_info().currsize:
        assert gl_context().error == "GL_NO_ERROR"


@pytest.fixture
def rng(request) -> np.random.Generator:
    """A generator seeded by the test's name: the same in every run, another in every test."""
    return np.random.default_rng(list(request.node.nodeid.encode()))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with the arms and the kitchen; tests that need it are skipped where absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"the real meshes are not present (looked for {SHARED_DATA})")
    return SHARED_DATA


@pytest.fixture
def rounds(request) -> int:
    """How often the poses of a mesh are drawn."""
    return request.config.getoption("--rounds")


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[Browser]:
    """A browser of the tests of one file; without one they skip."""
    if find_chromium() is None:
        pytest.skip("no Chromium or Chrome in the PATH; the page is not tried in a browser")
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()

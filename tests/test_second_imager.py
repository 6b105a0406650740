"""The arm scanner with both imagers of its cameras: the page says what its numbers say."""

import re

import pytest
import second_imager as program


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("docs")
    with pytest.MonkeyPatch.context() as patch:
        words = ["second_imager", "--maps", "60", "--workers", "1", "--docs", str(folder)]
        patch.setattr("sys.argv", words)
        assert program.main() == 0
    return folder


def test_two_imagers_see_less_than_one_pinhole(page):
    text = (page / "second-imager.md").read_text(encoding="utf-8")
    rows = re.findall(r"\| ([\d.]+) % \| ([\d.]+) % \| ([\d.]+) % \|", text)
    assert len(rows) == 3
    for one, two, remains in (map(float, row) for row in rows):
        assert two < one and remains == pytest.approx(100 * two / one, abs=0.2)


def test_the_picture_is_there(page):
    assert (page / "pictures" / program.PICTURE).read_bytes().startswith(b"\x89PNG")

"""The pages of the manual: Markdown files in ``glvis/docs``, in the checkout and in the wheel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from glvis.errors import StudyError
from glvis.problem.expressions import nearest

_FOLDER = Path(__file__).resolve().parents[1] / "docs"
# From what a user needs first to what few need; a page that is missing here comes last.
_ORDER = (
    "study", "sensors", "results", "visibility", "search", "python", "paper", "benchmarks",
    "cluster",
)  # fmt: skip


@dataclass(frozen=True)
class Page:
    """A page of the manual.

    Attributes
    ----------
    name : str
        As ``glvis docs NAME`` takes it.
    about : str
        What it tells, in one line: the first one below its title.
    text : str
        The whole of it, Markdown.
    """

    name: str
    about: str
    text: str


def read_pages() -> list[Page]:
    """Return all pages, those first that a user needs first."""
    names = [path.stem for path in _FOLDER.glob("*.md")]
    places = {name: place for place, name in enumerate(_ORDER)}
    return [_read(name) for name in sorted(names, key=lambda n: (places.get(n, len(places)), n))]


def read_page(name: str) -> Page:
    """Return one page.

    Raises
    ------
    StudyError
        If there is none of the name; names those that are there.
    """
    names = [page.name for page in read_pages()]
    if name not in names:
        hint = nearest(name, names) or ";"
        raise StudyError(f"there is no page '{name}'{hint} pages are {', '.join(names)}")
    return _read(name)


def _read(name: str) -> Page:
    text = (_FOLDER / f"{name}.md").read_text(encoding="utf-8")
    about = next(line for line in text.splitlines()[1:] if line.strip())
    return Page(name, about, text)

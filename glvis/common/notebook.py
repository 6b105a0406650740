"""Tables as notebooks show them: plain HTML whose texts are texts, whatever they hold."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def html_table(caption: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; floats with four digits, at the right like all numbers.

    Parameters
    ----------
    caption : str
        Above it.
    header : sequence of str
        Names of the columns; without any there is no such row.
    rows : iterable of sequences
        Cells.
    """
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return (
        f'<table><caption style="text-align:left">{escape(caption)}</caption>'
        f"{f'<thead><tr>{head}</tr></thead>' if head else ''}<tbody>{body}</tbody></table>"
    )


def _cell(value: object) -> str:
    if isinstance(value, str):
        return f'<td style="text-align:left">{escape(value)}</td>'
    return f"<td>{f'{value:.4g}' if isinstance(value, float) else f'{value:,}'}</td>"

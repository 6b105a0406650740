"""Commands that tell what glvis knows: the keys of a study, the pages of the manual."""

from __future__ import annotations

from typing import Annotated

import typer

commands = typer.Typer()


@commands.command(epilog="Examples:  glvis keys  and  glvis keys objective")
def keys(
    about: Annotated[
        str, typer.Argument(metavar="TABLE", help="Only of a table, or of those with a key.")
    ] = "",
) -> None:
    """List every key that a study may have: its default and what it means."""
    from glvis.inputs.keys import tables_about
    from glvis.terminal import listing, say

    tables = tables_about(about)
    say("Each key, what it is where the study leaves it out, and what it means.")
    for table in tables:
        say()
        say(f"{table.name}: {table.about}")
        for line in listing(list(table.rows())):
            say(line, to_paste=True)


@commands.command(epilog="Examples:  glvis docs  and  glvis docs study")
def docs(
    page: Annotated[
        str, typer.Argument(metavar="PAGE", help="Show this page, as Markdown, and not the list.")
    ] = "",
) -> None:
    """List the pages of the manual, or show one."""
    from glvis.manual import read_page, read_pages
    from glvis.terminal import listing, say

    if page:
        typer.echo(read_page(page).text, nl=False)
        return
    say("Pages of the manual; 'glvis docs PAGE' shows one.")
    for line in listing([(page.name, page.about) for page in read_pages()]):
        say(line)

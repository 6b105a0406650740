"""Commands that tell what glvis knows: the keys of a study, its schema, the pages of the manual."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glvis.errors import MachineError, StudyError

commands = typer.Typer()


@commands.command(epilog="Examples:  glvis keys  and  glvis keys objective")
def keys(
    about: Annotated[
        str, typer.Argument(metavar="TABLE", help="Only of a table, or of those with a key.")
    ] = "",
) -> None:
    """List every key that a study may have: its default and what it means."""
    from glvis.cli.terminal import listing, say
    from glvis.study.keys import tables_about

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
    from glvis.cli.manual import read_page, read_pages
    from glvis.cli.terminal import listing, say

    if page:
        typer.echo(read_page(page).text, nl=False)
        return
    say("Pages of the manual; 'glvis docs PAGE' shows one.")
    for line in listing([(page.name, page.about) for page in read_pages()]):
        say(line)


@commands.command(epilog="Example:  glvis schema -o study.schema.json")
def schema(
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write it there instead.")
    ] = None,
) -> None:
    """Print the JSON schema of the study file, from which editors complete and check it.

    Editors with Taplo, or Even Better TOML, hold a study against the file that its first line
    names, as '#:schema study.schema.json' names one beside it. 'glvis init' writes both.
    """
    from glvis.cli.terminal import say
    from glvis.study.json_schema import schema_text

    if output is None:
        typer.echo(schema_text(), nl=False)
        return
    if output.suffix != ".json":  # it takes the place of what is there: never of a study
        raise StudyError(f"-o {output}: must end in .json, as study.schema.json")
    try:
        output.write_text(schema_text(), encoding="utf-8")
    except OSError as error:
        raise MachineError(f"{output}: cannot be written to: {error.strerror}") from error
    say(f"Wrote {output}")

"""`stratify validate`: hold the models against everything that is known on paper."""

import json
import sys
from pathlib import Path

import click

from compare.cli.options import force_option, json_option, path_type
from compare.cli.terminal import counting, open_console, say
from compare.validation import chosen, page, record, table
from compare.validation import validate as run_checks
from compare.validation.report import made, tally
from experiment.archive.files import refuse_existing, refuse_folder, whole_file

__all__ = ["validate"]

DOES_NOT_HOLD = 1


@click.command()
@click.option(
    "--only",
    multiple=True,
    metavar="NAME",
    help="A group or a subject of it, such as lattice or continuum.profile.",
)
@click.option(
    "-o",
    "--output",
    "path",
    type=path_type,
    metavar="FILE.md",
    help="Write what was found as a page in Markdown, too.",
)
@json_option
@force_option
def validate(only: tuple[str, ...], path: Path | None, as_json: bool, force: bool) -> None:
    """Run the models against closed forms, conservation laws, each other, and what was observed.

    Prints one table; the exit status is 1 where a check does not hold. What was observed in
    experiments is compared but not counted. All of it takes a minute or two, once kernels are
    compiled.

    Example: stratify validate --only lattice
    """
    subjects = chosen(only)
    if path is not None:
        refuse_folder(path)
        refuse_existing([path], force=force)
    console = open_console(stderr=as_json)
    with counting("validation", len(subjects), console) as progress:
        found = run_checks(subjects, progress)
    by = made()
    if path is not None:
        with whole_file(path, force=force) as part:
            part.write_text(page(found, by), encoding="utf-8")
        say(f"wrote {path}", console)
    told = record(found, by)
    if as_json:
        click.echo(json.dumps(told, indent=2))
    else:
        console.print(table(found))
        say(tally(found))
    if not told["holds"]:
        sys.exit(DOES_NOT_HOLD)

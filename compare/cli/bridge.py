"""`stratify bridge`: what the lattice at the continuum's rates owes to its grains and its rule."""

import json
from contextlib import ExitStack
from pathlib import Path

import click

from compare.bridge import STUDIES
from compare.bridge.record import study_record
from compare.cli.options import force_option, json_option, path_type
from compare.cli.terminal import open_bars, open_console, progress_on, say
from compare.pictures import save
from experiment.archive.files import refuse_existing, refuse_folder, whole_file
from experiment.archive.layout import CONVENTIONS, REFERENCES, history
from experiment.archive.provenance import made_by
from experiment.archive.storage import write_whole

__all__ = ["bridge"]


@click.command()
@click.argument("name", type=click.Choice(list(STUDIES)))
@click.option(
    "-o",
    "--output",
    "folder",
    type=path_type,
    default=Path("pours/bridge"),
    show_default=True,
    metavar="FOLDER",
)
@click.option(
    "--seeds",
    type=click.IntRange(2, 10_000),
    default=8,
    show_default=True,
    help="Piles of each set-up, which chance makes unlike.",
)
@click.option(
    "--workers", type=click.IntRange(1, 1000), help="Processes. Default: one a processor."
)
@json_option
@force_option
def bridge(
    name: str, folder: Path, seeds: int, workers: int | None, as_json: bool, force: bool
) -> None:
    """Pour a study of the bridge between the models, and tell it in numbers and a picture.

    In all of them the lattice takes the continuum's law grain by grain (`ca_model.rule = "rate"`).
    limit: its grains become small. between: its capture becomes a threshold. grains: they have
    their true size. Writes FOLDER/NAME.nc and FOLDER/NAME.png and prints a table; some minutes on
    all processors.

    Example: stratify bridge limit --seeds 8
    """
    data, drawing = folder / f"{name}.nc", folder / f"{name}.png"
    for path in (data, drawing):
        refuse_folder(path)
    refuse_existing([data, drawing], force=force)
    console = open_console(stderr=as_json)
    told = STUDIES[name]
    with open_bars(console) as bars, progress_on(name, bars) as progress:
        found = told.study(seeds, workers, progress)
    drawn = told.draw(found)
    with ExitStack() as stack:  # both files or none
        whole = [stack.enter_context(whole_file(path, force=force)) for path in (data, drawing)]
        write_whole(found.assign_attrs(_made()), whole[0], force=True)
        save(drawn, whole[1], force=True)
    say(f"wrote {data} and {drawing}", console)
    if as_json:
        click.echo(json.dumps(study_record(found), indent=2))
        return
    console.print(told.table(found))
    if "comment" in found.attrs:
        say(found.attrs["comment"])


def _made() -> dict[str, str]:
    return {
        "Conventions": CONVENTIONS,
        "source": made_by(),
        "references": REFERENCES,
        "history": history("poured"),
    }

"""`stratify figure`: draw a figure of the paper from the code."""

from contextlib import ExitStack
from pathlib import Path

import click

from compare.cli.options import force_option, path_type
from compare.cli.terminal import open_bars, progress_on, say
from compare.pictures import save
from compare.pictures.paper import FIGURES
from experiment.archive.files import refuse_existing, refuse_folder, whole_file
from experiment.archive.layout import CONVENTIONS, REFERENCES, history
from experiment.archive.provenance import made_by
from experiment.archive.storage import write_whole

__all__ = ["figure"]


@click.command()
@click.argument("name", type=click.Choice(list(FIGURES)))
@click.option(
    "-o",
    "--output",
    "folder",
    type=path_type,
    default=Path("pours/figures"),
    show_default=True,
    metavar="FOLDER",
)
@click.option("--data", "with_data", is_flag=True, help="Write NAME.nc, too: what is drawn.")
@force_option
def figure(name: str, folder: Path, with_data: bool, force: bool) -> None:
    """Draw a figure of the paper with the parameters of its caption.

    It is that of Makse, Phys. Rev. E 56, 7008 (1997). Writes FOLDER/NAME.pdf and FOLDER/NAME.png,
    the same bytes each time. What the paper sketches, onset and phase, is drawn from pours; phase
    takes a minute on all processors.

    Example: stratify figure profiles -o docs/figures --data
    """
    endings = [".pdf", ".png", *([".nc"] if with_data else [])]
    paths = {ending: folder / f"{name}{ending}" for ending in endings}
    for path in paths.values():
        refuse_folder(path)
    refuse_existing(paths.values(), force=force)
    told = FIGURES[name]
    with open_bars() as bars, progress_on(name, bars) as progress:
        data = told.data(progress)
    drawn = told.draw(data)
    with ExitStack() as stack:  # all files or none
        parts = {e: stack.enter_context(whole_file(p, force=force)) for e, p in paths.items()}
        for ending, part in parts.items():
            if ending == ".nc":
                write_whole(data.assign_attrs(_made()), part, force=True)
            else:
                save(drawn, part, force=True)
    say(f"wrote {', '.join(map(str, paths.values()))}")


def _made() -> dict[str, str]:
    return {
        "Conventions": CONVENTIONS,
        "source": made_by(),
        "references": REFERENCES,
        "history": history("drawn"),
    }

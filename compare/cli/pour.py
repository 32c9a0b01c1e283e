"""`stratify pour`: pour a set-up, by one model or both."""

from pathlib import Path

import click

from compare.campaign import CHECK, POUR
from compare.cli.inputs import folder_of, load_setup
from compare.cli.options import force_option, path_type, set_option
from compare.cli.terminal import open_bars, progress_on, say
from experiment import Experiment, NotApplicableError
from experiment.archive import write
from experiment.files import make_folder, refuse_existing

__all__ = ["pour"]


@click.command()
@click.argument("setup")
@click.option(
    "--model",
    type=click.Choice([*POUR, "both"]),
    default="both",
    show_default=True,
    help="Which model pours.",
)
@click.option(
    "-o", "--output", "folder", type=path_type, metavar="FOLDER", help="Default: pours/SETUP."
)
@set_option
@force_option
def pour(
    setup: str, model: str, folder: Path | None, settings: tuple[str, ...], force: bool
) -> None:
    """Pour SETUP, a preset or a TOML file; write FOLDER/ca_model.nc and FOLDER/continuum.nc.

    Example: stratify pour glass-sugar --set 'feed.inflow=[0.2,0.2]' -o pours/thicker
    """
    experiment = load_setup(setup, settings)
    folder = folder or folder_of(setup)
    models = _applicable(experiment, list(POUR) if model == "both" else [model])
    paths = {name: folder / f"{name}.nc" for name in models}
    refuse_existing(paths.values(), force=force)
    make_folder(folder)
    for name, path in paths.items():
        with open_bars() as bars, progress_on(name, bars) as progress:
            archive = POUR[name](experiment, progress)
        say(f"{name}: wrote {write(archive, path, force=force)}")


def _applicable(experiment: Experiment, models: list[str]) -> list[str]:
    """Which of the models can pour; the others say why, and if none can, that is an error."""
    able: list[str] = []
    for name in models:
        try:
            CHECK[name](experiment)
        except NotApplicableError as refusal:
            if not able and name == models[-1]:
                raise
            say(f"{name}: does not apply: {refusal}")
        else:
            able.append(name)
    return able

"""`stratify phase`: map what both models do over fields of a set-up."""

import json
from pathlib import Path

import click

from compare.campaign import BEGIN, scheduler_of
from compare.cli.inputs import applicable, folder_of, load_setup, ruled
from compare.cli.options import force_option, json_option, path_type, rule_option, set_option
from compare.cli.stopping import told_how_to_go_on
from compare.cli.terminal import counting, open_console, say
from compare.phase.axes import axes_of, varied
from compare.phase.diagram import LINES, phase_to_file
from compare.phase.figure import draw_phase
from compare.phase.plan import plan_of, sound_setup
from compare.phase.summary import failures, phase_record, phase_table
from compare.pictures import save
from experiment import SetupError
from experiment.archive.files import refuse_existing

__all__ = ["phase"]

DEPOSITS = 8
MOST_REASONS = 10


@click.command()
@click.argument("setup")
@click.option(
    "--vary",
    multiple=True,
    required=True,
    metavar="KEY=VALUES",
    help="A field and its values: LOW:HIGH:COUNT, LOW:HIGH:COUNT:log, or V,V,V; or LOW:HIGH, "
    "to be drawn.",
)
@click.option(
    "--draws",
    type=click.IntRange(0, 1_000_000),
    default=0,
    show_default=True,
    help="Draws, a Latin hypercube, from all LOW:HIGH.",
)
@click.option("--model", type=click.Choice([*BEGIN, "both"]), default="both", show_default=True)
@click.option(
    "-o", "--output", "path", type=path_type, metavar="FILE", help="Default: pours/SETUP/phase.nc."
)
@rule_option
@set_option
@click.option(
    "--deposits",
    type=click.IntRange(0, 10_000),
    default=DEPOSITS,
    show_default=True,
    help="Points, evenly spread, whose deposits are kept as small pictures.",
)
@click.option(
    "--lines",
    type=click.IntRange(0, 10_000),
    default=LINES,
    show_default=True,
    help="Lines across the first field on which the spectrum is asked where growth begins.",
)
@click.option(
    "--workers", type=click.IntRange(1, 1000), help="Processes. Default: one a processor."
)
@click.option("--scheduler", metavar="ADDRESS", help="A Dask cluster, as in tcp://10.0.0.1:8786.")
@click.option("--resume", is_flag=True, help="Go on with a diagram that was stopped or killed.")
@json_option
@force_option
def phase(
    setup: str,
    vary: tuple[str, ...],
    draws: int,
    model: str,
    path: Path | None,
    rule: str | None,
    settings: tuple[str, ...],
    deposits: int,
    lines: int,
    workers: int | None,
    scheduler: str | None,
    resume: bool,
    as_json: bool,
    force: bool,
) -> None:
    """Pour SETUP at every point of a diagram, and map what the pours do.

    Writes FILE and, ending in .png, a picture of it. While it works, what is done is beside FILE in
    a folder that ends in .unfinished; a diagram that was stopped or killed goes on with --resume. A
    point that fails is told with its reason, and stops no other.

    Example: stratify phase makse-segregation --vary mixture.delta=-0.3:0.5:16 --vary
    mixture.psi=0.05:0.5:8
    """
    experiment = load_setup(setup, ruled(settings, rule, model, vary))
    path = path or folder_of(setup) / "phase.nc"
    if path.suffix != ".nc":
        raise SetupError(f"output = {path}: it should end in .nc")
    drawing = path.with_suffix(".png")
    refuse_existing([path, drawing], force=force or resume)
    console = open_console(stderr=as_json)
    axes = axes_of(*varied(vary), draws)
    models = list(BEGIN) if model == "both" else [model]
    sound = sound_setup(experiment, axes)
    models = applicable(sound, models, console, wanted=rule and "ca_model")
    plan = plan_of(experiment, axes, models, deposits, lines)
    share_out = scheduler_of(workers, scheduler, len(plan))
    with told_how_to_go_on("phase"), counting("phase", len(plan), console) as progress:
        diagram = phase_to_file(
            plan, path, share_out, resume=resume, force=force, progress=progress
        )
    save(draw_phase(diagram), drawing, force=force or resume)
    say(f"wrote {path} and {drawing}", console)
    if as_json:
        click.echo(json.dumps(phase_record(diagram), indent=2))
        return
    console.print(phase_table(diagram))
    for line in failures(diagram)[:MOST_REASONS]:
        say(line)

"""`stratify presets`: list and print the presets."""

import click

from experiment import load, preset_names, preset_text

__all__ = ["presets"]


@click.command()
@click.argument("name", required=False)
def presets(name: str | None) -> None:
    """List the presets, or print the one called NAME.

    Example: stratify presets glass-sugar > mine.toml
    """
    if name is not None:
        click.echo(preset_text(name), nl=False)
        return
    width = max(map(len, preset_names()))
    for preset in preset_names():
        click.echo(f"{preset:{width}}  {load(preset).title}")

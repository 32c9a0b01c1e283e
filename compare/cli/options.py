"""Options that several commands take."""

from pathlib import Path

import click

__all__ = ["force_option", "json_option", "path_type", "set_option"]

path_type = click.Path(path_type=Path)
force_option = click.option("--force", is_flag=True, help="Replace files that are there already.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
set_option = click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Change a field of the set-up."
)

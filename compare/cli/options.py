"""Options that several commands take."""

from pathlib import Path
from typing import get_args

import click

from ca_model.lattice import RuleName

__all__ = ["force_option", "json_option", "path_type", "rule_option", "set_option"]

path_type = click.Path(path_type=Path)
force_option = click.option("--force", is_flag=True, help="Replace files that are there already.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
set_option = click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Change a field of the set-up."
)
rule_option = click.option(
    "--rule",
    type=click.Choice(get_args(RuleName)),
    help="The lattice's rule, short for --set ca_model.rule=RULE.",
)

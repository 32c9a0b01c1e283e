"""The command line `stratify`: pour a mixture, compare the models, look at what came out."""

import sys
from importlib import import_module

import click

from experiment import StratifyError

__all__ = ["cli", "main"]

BAD_INPUT = 2
VERBS = [  # each a command in the module of its name
    "animate",
    "bridge",
    "compare",
    "converge",
    "explore",
    "figure",
    "measure",
    "phase",
    "pour",
    "presets",
    "show",
    "validate",
]


@click.group(help=__doc__, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="stratify")
def cli() -> None:
    """All commands hang here."""


for verb in VERBS:
    cli.add_command(getattr(import_module(f"compare.cli.{verb}"), verb))


def main() -> None:
    """Run the command line; what a user can mend ends in one line and exit status 2."""
    try:
        cli.main(standalone_mode=False)
    except StratifyError as error:
        _fail(str(error))
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        sys.exit(BAD_INPUT)
    except click.ClickException as error:
        _fail(error.format_message())
    except MemoryError as error:
        _fail(f"this takes more memory than there is: {error}")
    except (click.Abort, KeyboardInterrupt):
        _fail("stopped; what was not yet written under its name is lost")


def _fail(reason: str) -> None:
    click.echo(f"stratify: {' '.join(reason.split())}", err=True)
    sys.exit(BAD_INPUT)

"""`stratify explore`: a page to play with."""

import socket
from importlib.util import find_spec

import click

from compare.cli.terminal import say
from experiment import SetupError

__all__ = ["explore"]


@click.command()
@click.option("--address", default="127.0.0.1", show_default=True, help="Where to listen.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=5006,
    show_default=True,
    help="0 takes a free one.",
)
@click.option("--browser/--no-browser", default=True, help="Open the page in a browser.")
def explore(address: str, port: int, browser: bool) -> None:
    """Serve a page to play with: turn repose angles, sizes and flux, and see both models pour.

    Only this machine can reach it, unless --address says otherwise; it needs no other. Ctrl-C ends
    it. Needs Panel: pip install 'stratify[explore]'.

    Example: stratify explore --port 0
    """
    if find_spec("panel") is None:
        raise SetupError("the page is served by Panel: pip install 'stratify[explore]'")
    _check_listening(address, port)
    from compare.explore.server import serve

    serve(address, port, lambda url: say(f"explore at {url}; Ctrl-C ends it"), show=browser)


def _check_listening(address: str, port: int) -> None:
    """Raises :class:`SetupError` where nobody can listen."""
    try:
        family = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0][0]
        socket.create_server((address, port), family=family).close()
    except (OSError, UnicodeError) as error:
        reason, *_ = (getattr(error, "strerror", None) or str(error)).split(" (")
        raise SetupError(
            f"--address {address} --port {port}: nobody can listen there: {reason.lower()}; "
            "--address 127.0.0.1 is this machine, --port 0 takes a free port"
        ) from None

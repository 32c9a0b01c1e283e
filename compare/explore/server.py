"""The server of the page: every visitor has a desk of their own; nothing comes from elsewhere."""

import logging
import signal
import socket
from collections.abc import Callable

import panel as pn
from bokeh.server.server import Server
from bokeh.settings import settings
from tornado.websocket import WebSocketClosedError

from compare.explore.controls import STYLE
from compare.explore.page import WORKERS, Page

__all__ = ["serve"]

LOOPBACK = ("127.0.0.1", "localhost", "::1")
EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104
TITLE = "stratify: pour a mixture"


def serve(address: str, port: int, announce: Callable[[str], object], *, show: bool) -> None:
    """Serve the page at an address and port (0: a free one) until the process is told to end.

    `announce` is told where it is.
    """
    pn.extension(raw_css=[STYLE], notifications=False)
    server = pn.io.server.get_server(
        {"/": lambda: Page().layout},
        address=address,
        port=port,
        title={"/": TITLE},
        location=False,
    )
    port = server.port or port
    settings.allowed_ws_origin = _origins(address, port)
    _say_only_what_is_amiss()
    announce(f"http://{_host(address)}:{port}/")
    if show:
        server.io_loop.add_callback(server.show, "/")
    _until_told_to_end(server)
    WORKERS.shutdown(wait=False, cancel_futures=True)


def _say_only_what_is_amiss() -> None:
    """That a visitor leaves is not."""
    for name in ("bokeh", "panel"):
        logging.getLogger(name).setLevel(logging.ERROR)

    def amiss(record: logging.LogRecord) -> bool:
        return not (record.exc_info and isinstance(record.exc_info[1], WebSocketClosedError))

    logging.getLogger("asyncio").addFilter(amiss)


def _until_told_to_end(server: Server) -> None:
    def end(*_: object) -> None:
        server.io_loop.add_callback_from_signal(server.io_loop.stop)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    server.start()
    server.io_loop.start()
    server.stop()


def _origins(address: str, port: int) -> list[str]:
    """By what names the page may be called: on loopback, nobody else's name leads to it."""
    if address in EVERYWHERE:
        return ["*"]
    return [f"{_host(name)}:{port}" for name in {*LOOPBACK, address, socket.gethostname().lower()}]


def _host(name: str) -> str:
    return f"[{name}]" if ":" in name else name

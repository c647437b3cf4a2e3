"""Serve this program's documentation on loopback. Ctrl-C ends it."""

from __future__ import annotations

import argparse
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from gateway.cli.command import flag, whole_number
from gateway.errors import StartError

SITE = Path(__file__).parents[1] / "docs_site"  # built by `make site`
KIT = Path(__file__).parents[1] / "deploy_kit"  # in the wheel and the package; deploy/ elsewhere
ADDRESS, PORT = "127.0.0.1", 8481


class _Quiet(SimpleHTTPRequestHandler):
    """Logs no requests."""

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base's word
        """Do nothing."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("--port", metavar="N", default=str(PORT), help=f"the TCP port, else {PORT}; 0: any")
    flag(parser, "--path", about="print the folder where it lies, and end")
    flag(
        parser,
        "--deploy",
        about="print the folder of what an installation needs: unit, udev rules, the broker's files, and end",
    )


def run(args: argparse.Namespace) -> int:
    """Serve until interrupted, or print the folder."""
    port = whole_number(args.port, "--port", low=0, high=0xFFFF)
    if args.deploy:
        if not KIT.exists():
            raise StartError(
                f"{KIT}: only the wheel and the package have it", "look into deploy/ of the source"
            )
        print(KIT)
        return 0
    if not (SITE / "index.html").exists():
        raise StartError(f"{SITE}: the documentation is not built", "run `make site`, or read docs/")
    if args.path:
        print(SITE)
        return 0
    with server_of(port) as server:
        print(f"Documentation at http://{ADDRESS}:{server.server_port}/ - Ctrl-C ends it", flush=True)
        server.serve_forever()
    return 0


def server_of(port: int) -> ThreadingHTTPServer:
    """Return a server of the site on loopback, listening already; StartError when the port is in use."""
    try:
        return ThreadingHTTPServer((ADDRESS, port), partial(_Quiet, directory=str(SITE)))
    except OSError as error:
        raise StartError(f"{ADDRESS}:{port}: {error.strerror}", "take another --port") from error

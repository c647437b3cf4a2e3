"""Run the gateway. SIGTERM ends it in order, SIGHUP reads the configuration again."""

from __future__ import annotations

import argparse
import asyncio
import faulthandler
import logging
import os
import signal
import sys
from pathlib import Path

from gateway.app.build import build
from gateway.app.gateway import Reload
from gateway.app.io import MACHINE, Io
from gateway.app.site import Site
from gateway.cli.command import flag
from gateway.cli.restore.backup import upgrade_site
from gateway.system.gc_tuning import use_one_arena
from gateway.system.instance_lock import instance_lock
from gateway.system.log_thread import BackgroundHandler
from gateway.system.systemd import Notifier, PriorityFormatter, is_journal, watchdog_interval_s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("config", metavar="CONFIG", help="the site's TOML file")
    flag(parser, "-v", "--verbose", about="log every frame")


def run(args: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT; ConfigError, NewerError, or StartError beside another gateway."""
    use_one_arena()
    path = Path(args.config)
    site = Site.read(path, os.environ)
    faulthandler.enable()  # systemd's SIGABRT ends a hang: it is to say where
    log_to_stderr(is_verbose=args.verbose)
    with instance_lock(site.state_dir):
        os.umask(0o077)  # whatever is made from now on is for the gateway's own user
        asyncio.run(serve_site(path, site))
    return 0


async def serve_site(path: Path, site: Site, *, io: Io = MACHINE) -> None:
    """Run the gateway of a site until SIGTERM or SIGINT; SIGHUP makes it read its file again."""
    upgrade_site(path, site)
    notifier = Notifier(os.environ)
    loop = asyncio.get_running_loop()
    ending: asyncio.Future[str] = loop.create_future()
    app = build(site, notifier=notifier, watchdog_every_s=watchdog_interval_s(os.environ), io=io)
    reload = Reload(lambda: Site.read(path, os.environ), app, notifier)

    def end(reason: str) -> None:
        if not ending.done():
            notifier.stopping(reason)
            reload.cancel()
            ending.set_result(reason)

    def begin_reload() -> None:
        if not ending.done():
            reload.begin()

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, end, f"ended by {number.name}")
    loop.add_signal_handler(signal.SIGHUP, begin_reload)
    await app.run(ending)


def log_to_stderr(*, is_verbose: bool, instead: int | None = None) -> None:
    """Log without waiting, to stderr or `instead` to a file's descriptor.

    People get the time with each line, the journal gets priorities.
    """
    handler = BackgroundHandler(sys.stderr.fileno() if instead is None else instead)
    if is_journal(os.environ, sys.stderr):
        handler.setFormatter(PriorityFormatter())
    else:
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.DEBUG if is_verbose else logging.INFO, handlers=[handler], force=True)
    logging.getLogger("asyncio").setLevel(logging.WARNING)

"""`starter-gateway run`: the service."""

from __future__ import annotations

import argparse
import asyncio
import faulthandler
import gc
import logging
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

from gateway.app import App
from gateway.background_log import BackgroundHandler
from gateway.commands.command import Subparsers
from gateway.config.load import load
from gateway.config.schema import Config
from gateway.config.secrets import mqtt_password
from gateway.errors import ConfigError
from gateway.starters.records import Severity
from gateway.systemd import Notifier, PriorityFormatter, is_journal, watchdog_interval_s

log = logging.getLogger(__name__)

RELOAD = "reload"


def add_parser(subparsers: Subparsers) -> None:
    """Add the command's parser."""
    parser = subparsers.add_parser(
        "run", description="Run the gateway. SIGTERM ends it in order, SIGHUP reads the configuration again."
    )
    parser.add_argument("config", metavar="CONFIG", help="the site's TOML file")
    parser.add_argument("-v", "--verbose", action="store_true", help="log every frame")


def run(args: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT; ConfigError when the configuration is wrong."""
    path = Path(args.config)
    config, password = _read(path)
    faulthandler.enable()  # systemd's SIGABRT ends a hang: it is to say where
    log_to_stderr(is_verbose=args.verbose)
    asyncio.run(serve(path, config, password))
    return 0


async def serve(
    path: Path, config: Config, password: str | None, *, beside: Callable[[], Awaitable[None]] | None = None
) -> None:
    """Run gateways one after the other: a reload ends the present one as soon as the new file is good.

    `beside` is awaited once the first one has begun; when it returns, everything ends.
    """
    service = _Service(path)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, service.end, f"ended by {number.name}")
    loop.add_signal_handler(signal.SIGHUP, service.reload)
    companion = None if beside is None else asyncio.ensure_future(beside())
    if companion is not None:
        companion.add_done_callback(lambda _: service.end("ended"))
    while await service.run(config, password) == RELOAD:
        config, password = service.next
    if companion is not None:
        companion.cancel()
        await asyncio.gather(companion, return_exceptions=True)


def log_to_stderr(*, is_verbose: bool) -> None:
    """Log to stderr without waiting for it: for people with the time, for the journal with priorities."""
    handler = BackgroundHandler(sys.stderr.fileno())
    if is_journal(os.environ, sys.stderr):
        handler.setFormatter(PriorityFormatter())
    else:
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.DEBUG if is_verbose else logging.INFO, handlers=[handler], force=True)
    logging.getLogger("asyncio").setLevel(logging.WARNING)


class _Service:
    """The present gateway and why it ends."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._notifier = Notifier(os.environ)
        self._ending: asyncio.Future[str] | None = None
        self._app: App | None = None
        self._over = ""
        self.next: tuple[Config, str | None]

    async def run(self, config: Config, password: str | None) -> str:
        """Run one gateway and return why it ended."""
        self._ending = asyncio.get_running_loop().create_future()
        if self._over:  # asked to end between two gateways
            return self._over
        self._app = App(
            config,
            folder=self._path.parent,
            password=password,
            notifier=self._notifier,
            watchdog_every_s=watchdog_interval_s(os.environ),
        )
        _spare_the_collector()
        await self._app.run(self._ending)
        return self._ending.result()

    def end(self, reason: str) -> None:
        """End the present gateway and with it everything."""
        if not self._over:
            self._over = reason
            self._notifier.stopping(reason)
            self._finish(reason)

    def reload(self) -> None:
        """Take over the configuration anew; a wrong one changes nothing but is told."""
        if self._over or self._app is None:
            return
        try:
            self.next = _read(self._path)
        except ConfigError as error:
            for line in str(error).splitlines():
                log.error("reload refused: %s", line)  # noqa: TRY400 - the problems say it all
            text = f"the new configuration is refused, the old one goes on: {error.problems[0]}"
            self._app.tell("config_refused", Severity.ERROR, text)
            return
        log.info("reload: the new configuration is good")
        self._notifier.reloading()
        self._finish(RELOAD)

    def _finish(self, reason: str) -> None:
        if self._ending is not None and not self._ending.done():
            self._ending.set_result(reason)


def _spare_the_collector() -> None:
    """Take what lives as long as the gateway out of garbage collection: a full one would stop every loop."""
    gc.unfreeze()  # the gateway before a reload may go
    gc.collect()
    gc.freeze()


def _read(path: Path) -> tuple[Config, str | None]:
    config = load(path)
    return config, mqtt_password(config, path.parent, os.environ)

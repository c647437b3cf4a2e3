"""A PostgreSQL of the test's own, on a Unix socket in a temporary folder; it must run as an ordinary user."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from pg8000.exceptions import DatabaseError, InterfaceError
from pg8000.native import Connection

from tests.ordinary_user import UNPRIVILEGED, give

PATIENCE_S = 20.0
USER = "historian"


def programs() -> Path | None:
    """Return the folder of the newest PostgreSQL that is installed."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"), key=lambda path: int(path.parts[-3]))
    return found[-1].parent if found else None


class Database:
    """One server; `environ` says to a client where it is."""

    def __init__(self, folder: Path, bin_: Path) -> None:
        self._folder = folder
        self._bin = bin_
        self._process: subprocess.Popen[bytes] | None = None
        self.environ = {"PGHOST": str(folder), "PGUSER": USER, "PGDATABASE": "postgres"}
        command = ["initdb", "-D", str(folder / "data"), "-U", USER, "-A", "trust", "--no-sync"]
        self._spawn(*command, "--locale=C", "--encoding=UTF8").wait(PATIENCE_S)

    def start(self) -> None:
        """Start it, and wait until it lets us in."""
        options = ("-k", str(self._folder), "-c", "listen_addresses=", "-c", "max_wal_senders=0")
        self._process = self._spawn("postgres", "-D", str(self._folder / "data"), *options)
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                return self._connect().close()
            except (DatabaseError, InterfaceError, OSError):
                if self._process.poll() is not None or time.monotonic() > deadline_s:
                    raise RuntimeError((self._folder / "log").read_text("utf-8", "replace")) from None
            time.sleep(0.05)

    def crash(self) -> None:
        """End it as it ends itself when a part of it crashes: its clients are cut off."""
        if self._process is not None:
            self._process.send_signal(signal.SIGQUIT)
            self._process.wait(PATIENCE_S)
            self._process = None

    def run(self, text: str) -> list[list[Any]]:
        """Return the rows of a query."""
        with closing(self._connect()) as connection:
            return list(connection.run(text) or ())

    def _connect(self) -> Connection:
        socket = f"{self._folder}/.s.PGSQL.5432"
        return Connection(USER, database="postgres", unix_sock=socket, timeout=PATIENCE_S)

    def _spawn(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        ordinary = (
            {"user": UNPRIVILEGED, "group": UNPRIVILEGED, "extra_groups": []} if os.geteuid() == 0 else {}
        )
        with (self._folder / "log").open("ab") as log:
            return subprocess.Popen(
                [str(self._bin / program), *arguments],
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                **ordinary,  # type: ignore[call-overload]
            )


@contextmanager
def database(bin_: Path) -> Iterator[Database]:
    """Give a running server that ends with the block."""
    # Not in pytest's folder: root's is closed to others, and a socket's path is short.
    folder = Path(tempfile.mkdtemp(prefix="pg-", dir="/tmp"))
    give(folder)
    made = Database(folder, bin_)
    try:
        made.start()
        yield made
    finally:
        made.crash()
        shutil.rmtree(folder, ignore_errors=True)

"""The terminal table against a real gateway and a real broker."""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import re
import signal
import struct
import sys
import termios
from pathlib import Path

import pytest

from tests.end_to_end.plant import plant
from tests.end_to_end.site import PATIENCE_S
from tests.mosquitto import StartMosquitto, missing_programs
from tests.waiting import until

pytestmark = pytest.mark.skipif(bool(missing_programs()), reason="mosquitto is not installed")

_CONTROL = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")


class Terminal:
    """A program on a terminal of its own, 40 lines of 150 signs."""

    def __init__(self, *arguments: str, path: str | None = None) -> None:
        self._arguments = arguments
        self._path = {} if path is None else {"PATH": path}
        self.text = ""

    async def __aenter__(self) -> Terminal:
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 150, 0, 0))
        environ = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
        self.process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            *self._arguments,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env={**environ, "TERM": "xterm", **self._path},
            start_new_session=True,
        )
        os.close(theirs)
        os.set_blocking(self._ours, False)
        asyncio.get_running_loop().add_reader(self._ours, self._read)
        return self

    async def __aexit__(self, *_: object) -> None:
        asyncio.get_running_loop().remove_reader(self._ours)
        if self.process.returncode is None:
            self.process.kill()
        await self.process.wait()
        os.close(self._ours)

    async def shows(self, pattern: str) -> None:
        """Wait until what is drawn from now on matches."""
        self.text = ""
        await until(
            lambda: re.search(pattern, self.text), lambda: f"it shows {pattern!r}:\n{self.text[-4000:]}"
        )

    def types(self, keys: str) -> None:
        os.write(self._ours, keys.encode())

    def _read(self) -> None:
        try:
            self.text += _CONTROL.sub("", os.read(self._ours, 65536).decode(errors="replace"))
        except OSError:  # its end
            asyncio.get_running_loop().remove_reader(self._ours)


@pytest.mark.long
async def test_the_table_follows_a_start_and_says_when_it_is_not_live(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    async with plant(broker, tmp_path) as (scada, gateway, config):
        async with Terminal("gateway", "watch", str(config)) as terminal:
            await terminal.shows(r"starters/plant +online +LIVE")
            await terminal.shows(r"pump +ready")
            await scada.command("pump", "start", "one")
            await terminal.shows(r"pump +running .* A .*alice start: confirmed")
            gateway.signal(signal.SIGSTOP)
            await terminal.shows(r"NOT LIVE for")
            gateway.signal(signal.SIGCONT)
            await terminal.shows(r"online +LIVE")
            terminal.types("q")
            assert await asyncio.wait_for(terminal.process.wait(), PATIENCE_S) == 0
        gateway.signal(signal.SIGTERM)
        assert await gateway.exit_code() == 0


@pytest.mark.parametrize("has_mosquitto", [True, False], ids=["Mosquitto", "the embedded broker"])
async def test_the_demo_shows_the_table_where_it_has_a_terminal_and_its_plant_runs(
    tmp_path: Path, *, has_mosquitto: bool
) -> None:
    async with Terminal(
        "gateway", "demo", "--plant", path=None if has_mosquitto else str(tmp_path)
    ) as terminal:
        await terminal.shows(r"starters/demo +online +LIVE")
        await terminal.shows(r"pump +running .*demo start: confirmed")
        terminal.process.send_signal(signal.SIGINT)
        assert await asyncio.wait_for(terminal.process.wait(), PATIENCE_S) == 0

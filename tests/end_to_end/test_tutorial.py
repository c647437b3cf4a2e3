"""docs/tutorial.md as somebody follows it: every command that needs no root, on simulated starters."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Mapping
from contextlib import AsyncExitStack
from pathlib import Path

from gateway.config.reading import parse
from tests.end_to_end.site import Program
from tests.mosquitto import Certificate, MosquittoBroker, StartMosquitto, free_port
from tests.reference.examples import tutorial_commands, tutorial_config

BASE = "starters/mcc1"
WITHIN_S = 60.0
MAY_FAIL = ("starter-gateway doctor",)  # this machine is no plant


class Reader:
    """Types the commands in a folder of its own, with this program as `starter-gateway`."""

    def __init__(self, folder: Path, replaced: Mapping[str, str]) -> None:
        self.folder = folder
        self._replaced = replaced
        programs = folder / "bin"
        programs.mkdir()
        program = programs / "starter-gateway"
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m gateway "$@"\n', "utf-8")
        program.chmod(0o755)
        self._environ = {
            **os.environ,
            "PATH": f"{programs}:{os.environ['PATH']}",
        }

    def passwords(self) -> dict[str, str]:
        """Return every login's password, as the kit has it; alice's is typed from now on."""
        logins = (self.folder / "broker-kit" / "logins").iterdir()
        found = {login.name: login.read_text("utf-8").strip() for login in logins}
        self._environ["STARTER_GATEWAY_MQTT_PASSWORD"] = found["alice"]
        return found

    def adapted(self, text: str) -> str:
        for old, new in self._replaced.items():
            text = text.replace(old, new)
        return text

    async def type(self, line: str) -> str:
        """Run a command to its end and return what it printed; it must succeed."""
        process = await asyncio.create_subprocess_shell(
            self.adapted(line),
            cwd=self.folder,
            env=self._environ,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        async with asyncio.timeout(WITHIN_S):
            out, _ = await process.communicate()
        text = out.decode()
        assert process.returncode == 0 or line.startswith(MAY_FAIL), f"{line}\n{text}"
        return text

    def program(self, line: str) -> Program:
        """Return a command that runs until it is ended."""
        words = self.adapted(line).split()[1:]
        return Program("gateway", *(str(self.folder / w) if w.endswith(".toml") else w for w in words))


class Follower:
    """Does what the tutorial says, line by line; `printed` is by command."""

    def __init__(self, reader: Reader, start_mosquitto: StartMosquitto, stack: AsyncExitStack) -> None:
        self._reader = reader
        self._start_mosquitto = start_mosquitto
        self._stack = stack
        self._gateway = AsyncExitStack()  # ends before the rest
        stack.push_async_callback(self._gateway.aclose)
        self._broker: MosquittoBroker
        self.printed: dict[str, str] = {}

    async def follow(self, line: str) -> None:
        words = line.split()
        match words[:2]:
            case ["starter-gateway", "simulate"]:
                simulator = await self._stack.enter_async_context(self._reader.program(line))
                await simulator.says("line pumps:")
            case ["starter-gateway", "run"]:
                gateway = await self._gateway.enter_async_context(self._reader.program(line))
                await gateway.says("pump-1 ready for remote control")
                await gateway.says("pump-2 ready for remote control")
            case ["install", _] if line.endswith(" ca.pem"):
                await self._reader.type(line)
                await self._start_broker()
            case ["starter-gateway", "broker-kit"] if line.endswith("--prove"):
                self.printed["prove"] = await self._reader.type(line)
            case _:
                name = words[4] if words[1] == "send" else words[1]
                self.printed[name] = await self._reader.type(line)

    async def _start_broker(self) -> None:
        """Start the broker with the kit, which root would install."""
        kit = self._reader.folder / "broker-kit"
        chain = kit / "chain.pem"  # the tests' own clients trust what the broker shows
        chain.write_bytes((kit / "broker.pem").read_bytes() + (kit / "ca.pem").read_bytes())
        self._broker = self._start_mosquitto(
            users=self._reader.passwords(),
            acl=(kit / "acl").read_text("utf-8"),
            tls=Certificate(chain, kit / "broker.key"),
            options=("use_username_as_clientid true",),
        )
        site = self._reader.folder / "site.toml"
        site.write_text(site.read_text("utf-8").replace(":8883", f":{self._broker.port}"), "utf-8")


async def test_the_tutorial_ends_with_a_motor_that_ran(
    tmp_path: Path, start_mosquitto: StartMosquitto
) -> None:
    changes = {
        "/dev/rs485-pumps": str(tmp_path / "rs485-pumps"),
        "[web] ": f'[web]\nlisten = "127.0.0.1:{free_port()}" ',
    }
    reader = Reader(tmp_path, changes)
    (tmp_path / "site.toml").write_text(reader.adapted(tutorial_config()), "utf-8")

    async with AsyncExitStack() as stack:
        follower = Follower(reader, start_mosquitto, stack)
        for line in tutorial_commands():
            await follower.follow(line)
    printed = follower.printed

    found = parse("# Found" + printed["scan"].partition("# Found")[2], "scan").lines[0].starters
    assert [(each.address, each.family) for each in found] == [(1, "ssw07"), (2, "ssw900")]
    assert "no problems\n" in printed["prove"]
    assert "line pumps" in printed["check"]
    assert "starter pump-1: is SSW-07" in printed["doctor"]
    assert "pump-1" in printed["watch"]
    assert "confirmed" in printed["start"]
    assert "confirmed" in printed["read"]
    assert "P003" in (tmp_path / "pump-1.toml").read_text("utf-8")

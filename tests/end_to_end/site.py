"""A site under test: configuration, starters, broker, and the gateway as a process."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from paho.mqtt import client as paho

from tests.listener import BrokerListener
from tests.rig.sites import ALICE, line, starter, table
from tests.waiting import until

PATIENCE_S = 20.0

PUMP = starter("pump", 1, "ssw07", every_s=0.2)
FOUR_FAMILIES = (
    PUMP
    + starter("fan", 2, "ssw06", every_s=0.2)
    + starter("mill", 3, "ssw900", every_s=0.2)
    + starter("belt", 4, "sst", every_s=0.2)
    + ALICE
)


def site_config(*, broker_port: int, port: str, starters: str = FOUR_FAMILIES, framing: str = "8N2") -> str:
    """Return the TOML text of a site with one line; its simulator may be late, as on a busy machine."""
    return (
        table("gateway", name="plant", state_dir="state", clock="trusted")  # the kernel's may not be
        + table("mqtt", url=f"mqtt://127.0.0.1:{broker_port}")
        + line("hall", port=port, framing=framing, adapter_allowance_s=0.3)
        + starters
    )


class Program:
    """A command of the gateway, or of another program, as a process of its own, its output retained."""

    def __init__(
        self,
        *arguments: str,
        environ: Mapping[str, str] | None = None,
        program: tuple[str, ...] = (sys.executable, "-m"),
    ) -> None:
        self._arguments = *program, *arguments
        self._environ = {**os.environ, **(environ or {})}
        self._process: asyncio.subprocess.Process | None = None
        self._reading: asyncio.Task[None] | None = None
        self.output = ""

    async def __aenter__(self) -> Program:
        self._process = await asyncio.create_subprocess_exec(
            *self._arguments,
            env=self._environ,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        self._reading = asyncio.create_task(self._read())
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._process is not None
        assert self._reading is not None
        if self._process.returncode is None:
            self._process.kill()
        await self._process.wait()
        await self._reading

    async def says(self, text: str, *, within_s: float = PATIENCE_S) -> None:
        """Wait until the program has printed `text`."""
        await until(lambda: text in self.output, lambda: f"it says {text!r}:\n{self.output}", within_s)

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def signal(self, number: signal.Signals) -> None:
        assert self._process is not None
        self._process.send_signal(number)

    async def exit_code(self, *, within_s: float = PATIENCE_S) -> int:
        """Wait for the end and return the exit code."""
        assert self._process is not None
        assert self._reading is not None
        async with asyncio.timeout(within_s):
            code = await self._process.wait()
            await self._reading
        return code

    async def _read(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        while text := await self._process.stdout.readline():
            self.output += text.decode(errors="replace")


class Scada(BrokerListener):
    """What an operator sees and does: the latest message of each topic, and commands; an async context.

    `login` is a user with its password, and the broker's authority, as a `BrokerListener` takes them.
    """

    def __init__(
        self, port: int, *, base: str = "starters/plant", client: str = "alice", **login: Any
    ) -> None:
        super().__init__(port, f"{base}/#", **login)
        self.base = base
        self.client = client
        self.latest: dict[str, Any] = {}
        self.results: list[dict[str, Any]] = []
        self.events: list[dict[str, Any]] = []
        self._loop = asyncio.get_running_loop()
        self._came: asyncio.Queue[paho.MQTTMessage] = asyncio.Queue()

    async def __aenter__(self) -> Scada:
        await asyncio.to_thread(self.start)
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.stop)

    def take(self, message: paho.MQTTMessage) -> None:
        self._loop.call_soon_threadsafe(self._came.put_nowait, message)

    async def until(self, topic: str, *, within_s: float = PATIENCE_S, **wanted: Any) -> dict[str, Any]:
        """Wait until the latest message of a topic (below the base) has all these fields; return it."""

        return await self._until(
            topic,
            lambda seen: all(seen.get(key) == value for key, value in wanted.items()),
            f"had {wanted}",
            within_s=within_s,
        )

    async def ready(self, starter: str) -> None:
        """Wait until a starter is ready, and known to be what is configured: then it takes commands."""
        await self.until(f"starter/{starter}/state", state="ready", quality="good")
        await self._until(f"starter/{starter}/info", lambda seen: bool(seen["firmware"]), "was identified")

    async def _until(
        self, topic: str, fits: Callable[[dict[str, Any]], bool], what: str, *, within_s: float = PATIENCE_S
    ) -> dict[str, Any]:
        try:
            async with asyncio.timeout(within_s):
                while topic not in self.latest or not fits(self.latest[topic]):
                    self._book(await self._came.get())
        except TimeoutError:
            last = self.results[-3:]
            raise AssertionError(
                f"{topic} never {what}: {self.latest.get(topic)}; last results: {last}"
            ) from None
        found: dict[str, Any] = self.latest[topic]
        return found

    async def token(self) -> str:
        """Return the present proof of freshness."""
        await self.until("gateway/status", state="online")
        while not self._came.empty():
            self._book(await self._came.get())
        return str(self.latest["gateway/fresh"]["token"])

    async def command(self, starter: str, verb: str, id_: str, **args: Any) -> None:
        """Publish a fresh command."""
        payload = {"id": id_, "token": await self.token(), "args": args}
        self.say(f"command/{starter}/{self.client}/{verb}", payload)

    def say(self, topic: str, payload: str | dict[str, Any] = "") -> None:
        """Publish on a topic below the base."""
        self.publish(f"{self.base}/{topic}", payload)

    def set_knob(self, starter: str, knob: str, setting: str) -> None:
        """Do at a simulated starter what a hand there would do."""
        self.publish(f"simulator/{starter}/{knob}", setting)

    async def result(self, starter: str, **wanted: Any) -> dict[str, Any]:
        """Wait for a result with all these fields and return it."""
        return await self.until(f"result/{starter}/{self.client}", **wanted)

    def phases(self, id_: str) -> list[str]:
        """Return the phases that a command has had so far."""
        return [result["phase"] for result in self.results if result["id"] == id_]

    def _book(self, seen: paho.MQTTMessage) -> None:
        topic = seen.topic.removeprefix(f"{self.base}/")
        if topic.startswith("command/"):
            return  # our own
        message = json.loads(seen.payload) if seen.payload else {}
        self.latest[topic] = message
        if topic.startswith("result/"):
            self.results.append(message)
        if topic.endswith("/event"):
            self.events.append(message)


def write_config(folder: Path, text: str) -> Path:
    path = folder / "site.toml"
    path.write_text(text, "utf-8")
    return path

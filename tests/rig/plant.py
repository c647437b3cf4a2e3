"""A plant: a gateway from TOML, its simulated lines, its broker, its page and its command line."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import logging
import os
import signal
import tempfile
import textwrap
from collections.abc import Awaitable, Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any
from unittest.mock import patch

import gateway.app.io
from gateway.app.io import Io
from gateway.app.site import Site
from gateway.cli.main import main
from gateway.cli.run import serve_site
from gateway.errors import PortError
from tests.rig import sparkplug
from tests.rig.broker import Broker, MqttMessage, RigClient, as_bytes, installed, matches
from tests.rig.line import RigLine, Starter
from tests.rig.state import heal_disk
from tests.rig.web import NoSocket, WebAnswer, WebBrowser
from tests.rig.world import START_S, RigWorld

GATEWAY = '[gateway]\nname = "plant"\nstate_dir = "state"\nclock = "trusted"\n'
MQTT = '[mqtt]\nurl = "mqtt://127.0.0.1"\n'
SHM = Path("/dev/shm")


@dataclass(frozen=True)
class Ran:
    """What a command of the command line did."""

    code: int
    out: str
    err: str


def run_cli(*arguments: str) -> Ran:
    """Run the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(each) for each in arguments])
    return Ran(code, out.getvalue(), err.getvalue())


class _Bugs(logging.Handler):
    """Whatever the gateway logs as a bug."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info:
            self.found.append(logging.Formatter().format(record))


class RigPlant:
    """A running gateway and all that is around it; `with RigPlant(toml) as plant`. See the package."""

    def __init__(
        self,
        toml: str,
        *,
        sim: Mapping[str, Mapping[str, Any]] | None = None,
        absent: tuple[str, ...] = (),
        files: Mapping[str, str] | None = None,
        before: Callable[[RigPlant], object] | None = None,
        seed: int = 0,
    ) -> None:
        self._sim = sim or {}  # by starter: options of the simulator; `family`: what is really there
        self._absent = absent
        self._files = files or {}  # beside the configuration: passwords, certificates; for their owner only
        self._before = before  # done before the gateway begins, such as to its broker
        self.world = RigWorld(seed)
        self.loop = self.world.loop
        self.broker = Broker(self.loop, self.world.now_s)
        self.brokers: dict[tuple[str, int], Broker] = {}  # others, by host and port
        self.lines: dict[str, RigLine] = {}
        self.bugs = _Bugs()
        self.page: Any = None  # its ASGI application
        self.browser = WebBrowser(self._page_now, self.await_)
        self._stack = ExitStack()
        self._ports: dict[str, RigLine] = {}
        self._serving: asyncio.Task[None] | None = None
        self._ids = 0
        self._toml = toml
        self.base = "starters/plant"
        self._outside = Io(
            make_opener=self._opener,
            has_line_thread=False,
            is_clock_synchronised=lambda: self.is_clock_synchronised,
            make_web_server=partial(NoSocket, partial(setattr, self, "page")),
        )
        self.is_clock_synchronised = True  # as the kernel says; asked with `clock = "auto"`

    def _opener(self, port: str, timing: Any) -> Any:
        if port not in self._ports:
            raise PortError(port, "no such port")
        return self._ports[port].lay(timing).opener(timing=timing)

    # Its life

    def __enter__(self) -> RigPlant:
        try:
            self._stack.callback(heal_disk)
            self._stack.callback(os.umask, os.umask(0o022))  # a gateway keeps its files to its owner
            self._stack.enter_context(self.world.entered())
            self._stack.enter_context(installed(lambda h, p: self.brokers.get((h, p), self.broker)))
            self._stack.enter_context(patch.object(gateway.app.io, "MACHINE", self._outside))
            folder = tempfile.TemporaryDirectory(prefix="rig-", dir=SHM if SHM.is_dir() else None)
            self.folder = Path(self._stack.enter_context(folder))
            self.path = self.folder / "site.toml"
            logging.getLogger("gateway").addHandler(self.bugs)
            self._stack.callback(logging.getLogger("gateway").removeHandler, self.bugs)
            self.write(self._toml)
            for name, content in self._files.items():
                (self.folder / name).touch(mode=0o600)
                (self.folder / name).write_text(content)
            if self._before is not None:
                self._before(self)
            self.start()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()
        assert kind is not None or not self.bugs.found, "\n".join(self.bugs.found)

    def write(self, toml: str) -> None:
        """Write the configuration's file; `[gateway]` and `[mqtt]` may be missing."""
        text = textwrap.dedent(toml)
        head = "".join(part for part in (GATEWAY, MQTT) if part.split("\n")[0] not in text.splitlines())
        self.path.write_text(head + text)

    def start(self) -> None:
        """Begin a run of the gateway; ConfigError for a configuration that cannot be used."""
        site = Site.read(self.path, {})
        self.base = site.config.base
        self._connect_starters(site)
        self._serving = self.loop.create_task(serve_site(self.path, site, io=self._outside))
        self.await_(asyncio.sleep(0))

    def end(self, number: signal.Signals = signal.SIGTERM) -> None:
        """End the run in order and wait for that."""
        if self._serving is not None:
            self.world.signal(number)
            serving, self._serving = self._serving, None
            self.loop.run_until_complete(serving)

    def kill(self) -> None:
        """End the run as SIGKILL does: connections are lost, nothing is said or stored."""
        self.broker.drop()
        for each in self.brokers.values():
            each.drop()
        serving, self._serving = self._serving, None
        if serving is not None:
            self.world.abandon()

    def restart(self) -> None:
        """End in order and begin again, with the same state, broker and starters."""
        self.end()
        self.start()

    def reload(self, toml: str) -> None:
        """Write another configuration and send SIGHUP."""
        self.write(toml)
        with contextlib.suppress(Exception):  # one that is to be refused connects nothing
            self._connect_starters(Site.read(self.path, {}))
        self.world.signal(signal.SIGHUP)

    def _connect_starters(self, site: Site) -> None:
        for table in site.config.lines:
            if table.port not in self._ports:
                line = RigLine(table.name, self.loop.call_later, self.world.now_s)
                self._ports[table.port] = line
            line = self.lines[table.name] = self._ports[table.port]
            for each in table.starters:
                if each.name not in line.starters and each.name not in self._absent:
                    options = {"family": each.family, "address": each.address, **self._sim.get(each.name, {})}
                    line.add(each.name, **options)

    def _close(self) -> None:
        self.world.abandon()
        self._stack.close()
        self.loop.close()

    # Time

    def run(self, until: float) -> None:
        """Let time pass up to a second of the scenario."""
        left_s = until - self.world.now_s()
        if left_s > 0:
            self.await_(asyncio.sleep(left_s))

    def await_(self, work: Awaitable[Any]) -> Any:
        """Let everything go on until something is done."""

        async def wait() -> Any:
            return await work

        result = self.loop.run_until_complete(wait())
        if self._serving is not None and self._serving.done():
            self._serving.result()
        return result

    def do(self, action: Callable[[], Any]) -> None:
        """Do something on the loop, at once."""

        async def act() -> None:
            action()
            await asyncio.sleep(0)

        self.await_(act())

    def stand_still(self, seconds: float) -> None:
        """Let the machine be busy with something else for so long."""
        self.loop.work(seconds)

    # Starters

    def starter(self, name: str) -> Starter:
        """Return a starter by its name or its address."""
        for line in self.lines.values():
            for each in line.starters.values():
                if name in (each.name, str(each.unit.address)):
                    return each
        raise KeyError(name)

    def line_of(self, starter: str) -> RigLine:
        return self.starter(starter).line

    # MQTT

    def client(self, name: str) -> RigClient:
        """Return a client at the broker."""
        return self.broker.client(name)

    def other_broker(self, host: str, port: int = 1883) -> Broker:
        """Return another broker, for a reload or for Sparkplug; all other addresses are the first one's."""
        return self.brokers.setdefault((host, port), Broker(self.loop, self.world.now_s))

    def topic(self, topic: str) -> str:
        """Return a topic of the contract below the gateway's base."""
        return topic if topic.startswith(("spBv1.0/", "homeassistant/", "/")) else f"{self.base}/{topic}"

    def messages(self, topic: str = "#", since: float = 0.0) -> list[MqttMessage]:
        """Return what was published on the topics of a filter, by anyone."""
        pattern = self.topic(topic) if topic != "#" else topic
        return [each for each in self.broker.log if each.at_s >= since and matches(pattern, each.topic)]

    def last(self, topic: str) -> Any:
        """Return what the newest message of a topic says."""
        found = self.messages(topic)
        return found[-1].json if found and found[-1].payload else None

    def token(self) -> str:
        """Return the newest proof of freshness."""
        return str(self.last("gateway/fresh")["token"])

    def command(self, path: str, /, *, fresh: bool = True, client: str | None = None, **fields: Any) -> str:
        """Publish a command on `command/STARTER/CLIENT/VERB`, with an id and a token; return its id."""
        self._ids += 1
        proof = {"token": self.token()} if fresh and "issued_at" not in fields else {}
        body = {"id": f"id-{self._ids}", **proof, **fields}
        user = client or path.split("/")[1]
        payload = json.dumps({name: value for name, value in body.items() if value is not None})
        self.publish(f"command/{path}", payload, client=user)
        return str(body["id"])

    def publish(self, topic: str, payload: Any = b"", *, client: str = "test", **properties: Any) -> None:
        """Publish as some client, without a connection of its own."""
        properties = {"qos": 1, "client": client, **properties}
        message = MqttMessage(self.world.now_s(), self.topic(topic), as_bytes(payload), **properties)
        self.do(lambda: self.broker.publish(message))

    def sparkplug(self, metrics: Mapping[str, bool | str]) -> bytes:
        """Return the payload of a Sparkplug command of this moment."""
        return sparkplug.encoded(metrics, time_s=self.world.utc_s())

    def results(self, starter: str = "+", client: str = "+") -> list[str]:
        """Return the results so far: `verb phase code`."""
        found = (each.json for each in self.messages(f"result/{starter}/{client}"))
        return [f"{each['verb']} {each['phase']} {each['code']}" for each in found]

    def events(self, topic: str = "gateway/event") -> list[str]:
        """Return the codes of the events so far."""
        return [each.json["code"] for each in self.messages(topic)]

    def transcript(self) -> str:
        """Return everything that was published, a message a line: the same at each run."""
        return "".join(f"{each}\n" for each in self.broker.log)

    # The page, and the command line

    def get(self, path: str, **headers: str) -> WebAnswer:
        return self.browser.get(path, **headers)

    def post(self, path: str, body: object = None, **headers: str) -> WebAnswer:
        return self.browser.post(path, body, **headers)

    def cli(self, *arguments: str) -> Ran:
        """Run the command line beside the running gateway; CONFIG stands for its file."""
        return run_cli(*(str(self.path) if each == "CONFIG" else each for each in arguments))

    def _page_now(self) -> Any:
        assert self.page is not None, "no page is served: [web] is missing, or it is too early"
        return self.page


__all__ = ["START_S", "Ran", "RigPlant", "run_cli"]

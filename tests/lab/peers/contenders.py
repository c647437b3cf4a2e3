"""The three that are compared: how each is run, configured, commanded and understood."""

from __future__ import annotations

import csv
import io
import json
import subprocess
import sys
import time
import uuid
import venv
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from gateway.contract import rfc3339
from tests.lab.peers.measure import CURRENT, CURRENT_PCT, RUNNING, Published

STARTERS = ("pump", "fan", "mill", "belt")
POINTS = (CURRENT, CURRENT_PCT, RUNNING)
BAUD, FRAMING = 19200, "8N2"  # a pseudo terminal takes no parity
REPLY_WITHIN_S = 0.5  # the peers' timeout: their default of 3 s would make everything six times as slow
MODPOLL = "modpoll[serial]==1.6.0"
WATCHDOG_S = 10
RUN_COIL, STATUS, CURRENTS = 100, 5001, 2


@dataclass(frozen=True)
class PeerSite:
    """Where a contender works."""

    folder: Path
    broker_port: int

    @property
    def port(self) -> Path:
        return self.folder / "ttyHALL"

    def configure(self, every_s: float) -> Path:
        """Write the gateway's configuration, which the simulated plant is made from as well."""
        starters = "".join(
            f'\n[[line.starter]]\nname = "{name}"\naddress = {address}\nfamily = "ssw07"\n'
            f"every_s = {every_s}\nwatchdog_s = {WATCHDOG_S}\n"
            for address, name in enumerate(STARTERS, 1)
        )
        path = self.folder / "site.toml"
        path.write_text(
            f'[gateway]\nname = "plant"\nstate_dir = "{self.folder}/state"\n\n'
            f'[mqtt]\nurl = "mqtt://127.0.0.1:{self.broker_port}"\n\n'
            f'[[line]]\nname = "hall"\nport = "{self.port}"\nbaud = {BAUD}\nframing = "{FRAMING}"\n{starters}'
            '\n[[operator]]\nclient = "alice"\nmay = ["*"]\nstarters = ["*"]\n',
            "utf-8",
        )
        return path


class Contender(ABC):
    """One of those that are compared."""

    name: str

    def environ(self, site: PeerSite) -> Mapping[str, str]:
        return {}

    @abstractmethod
    def command(self, site: PeerSite, every_s: float) -> list[str]:
        """Configure it and return how it is run; `every_s` = 0 is as fast as it can."""

    @abstractmethod
    def order(self, starter: str, verb: str, token: str) -> tuple[str, str]:
        """Return topic and payload of a start or stop."""

    @abstractmethod
    def read(self, topic: str, body: Any, received_s: float) -> Iterator[Published]:
        """Return what a message publishes; times are monotonic."""


class Ours(Contender):
    """This gateway, as `starter-gateway run` with a plain configuration."""

    name = "starter-gateway"

    def command(self, site: PeerSite, every_s: float) -> list[str]:
        return [sys.executable, "-m", "gateway", "run", str(site.configure(every_s))]

    def order(self, starter: str, verb: str, token: str) -> tuple[str, str]:
        body = {"id": uuid.uuid4().hex, "issued_at": rfc3339(time.time()), "ttl_s": 5}
        return f"starters/plant/command/{starter}/alice/{verb}", json.dumps(
            {**body, "token": token} if token else body
        )

    def read(self, topic: str, body: Any, received_s: float) -> Iterator[Published]:
        levels = topic.removeprefix("starters/plant/").split("/")
        match levels:
            case ["gateway", "status"] if body["state"] == "offline":
                yield from nothing_good(received_s)
            case ["starter", starter, "value", point] if point in POINTS:
                yield _published(starter, point, body, received_s)
            case ["starter", starter, "state"] if RUNNING in body:
                yield _published(starter, RUNNING, {**body, "value": body[RUNNING]}, received_s)
            case ["starter", starter, "history"]:
                for item in body["items"]:
                    if item["point"] in POINTS:
                        yield _published(starter, item["point"], item, received_s, is_live=False)
            case _:
                return


class Script(Contender):
    """`script.py`, with the newest pymodbus and paho of the project's own environment."""

    name = "pymodbus + paho"

    def command(self, site: PeerSite, every_s: float) -> list[str]:
        path = Path(__file__).with_name("script.py")
        return [sys.executable, "-u", str(path), str(site.port), str(site.broker_port), str(every_s)]

    def order(self, starter: str, verb: str, token: str) -> tuple[str, str]:
        return f"plant/{starter}/set", verb

    def read(self, topic: str, body: Any, received_s: float) -> Iterator[Published]:
        base, _, starter = topic.partition("/")
        if base == "plant" and starter in STARTERS:
            for point in POINTS:
                yield Published(
                    starter, point, float(body[point]), received_s, _monotonic(body["time"], received_s)
                )


class Modpoll(Contender):
    """modpoll from PyPI in an environment of its own; `is_corrected`: one word of its writes is replaced."""

    def __init__(self, home: Path, *, is_corrected: bool = False) -> None:
        self.name = "modpoll, corrected" if is_corrected else "modpoll"
        self._home = home
        self.is_corrected = is_corrected

    def environ(self, site: PeerSite) -> Mapping[str, str]:
        if not self.is_corrected:
            return {}
        (source,) = self._home.glob("lib/python*/site-packages/modpoll")
        copy = site.folder / "corrected" / "modpoll"
        copy.mkdir(parents=True, exist_ok=True)
        for path in source.glob("*.py"):
            text = path.read_text("utf-8").replace("unit=dev.devid", "slave=dev.devid")
            (copy / path.name).write_text(text, "utf-8")
        return {"PYTHONPATH": str(copy.parent)}

    def command(self, site: PeerSite, every_s: float) -> list[str]:
        config = site.folder / "modpoll.csv"
        config.write_text(modpoll_table(), "utf-8")
        options = {
            "--config": config,
            "--rtu": site.port,
            "--rtu-baud": BAUD,
            "--rtu-parity": "none",
            "--timeout": REPLY_WITHIN_S,
            "--rate": every_s,
            "--interval": 0.0,  # between two polls
            "--mqtt-host": "127.0.0.1",
            "--mqtt-port": site.broker_port,
            "--mqtt-version": "5.0",  # with 3.1.1, its default, 1.6.0 cannot connect at all
            "--mqtt-qos": 1,
            "--mqtt-clientid": "modpoll",
        }
        words = [str(word) for pair in options.items() for word in pair]
        return [str(self._home / "bin" / "python"), "-m", "modpoll", "--daemon", "--timestamp", *words]

    def order(self, starter: str, verb: str, token: str) -> tuple[str, str]:
        body = {"object_type": "coil", "address": RUN_COIL, "value": verb == "start"}
        return f"modpoll/{starter}/set", json.dumps(body)

    def read(self, topic: str, body: Any, received_s: float) -> Iterator[Published]:
        match topic.split("/"):
            case ["modpoll", starter, "data"]:
                time_s = _monotonic(body["timestamp"], received_s)
                values = {key.partition("|")[0]: value for key, value in body.items()}
                for point in POINTS:
                    value = values[point]
                    yield Published(
                        starter, point, None if value is None else float(value), received_s, time_s
                    )
            case _:
                return


def contenders(home: Path) -> tuple[Contender, ...]:
    """Return all of them; modpoll is installed into `home`, unless it is there."""
    if not (home / "ready").exists():
        venv.create(home, with_pip=True, clear=True)
        subprocess.run([str(home / "bin" / "python"), "-m", "pip", "install", "--quiet", MODPOLL], check=True)
        (home / "ready").touch()
    return Ours(), Modpoll(home), Modpoll(home, is_corrected=True), Script()


def nothing_good(received_s: float) -> Iterator[Published]:
    """Say of every value that it is not to be trusted from now on."""
    for starter in STARTERS:
        for point in POINTS:
            yield Published(starter, point, None, received_s, received_s)


def modpoll_table() -> str:
    """Return modpoll's configuration: the same two reads for each starter as everybody makes."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    for address, name in enumerate(STARTERS, 1):
        rows.writerow(("device", name, address, "", ""))
        rows.writerow(("poll", "holding_register", STATUS, 1, "BE_BE"))
        rows.writerow(("ref", RUNNING, f"{STATUS}:0", "bool", "r"))
        rows.writerow(("poll", "holding_register", CURRENTS, 2, "BE_BE"))
        rows.writerow(("ref", CURRENT_PCT, CURRENTS, "uint16", "r", "%", 0.1))
        rows.writerow(("ref", CURRENT, CURRENTS + 1, "uint16", "r", "A", 0.1))
    return text.getvalue()


def _published(
    starter: str, point: str, body: Mapping[str, Any], received_s: float, *, is_live: bool = True
) -> Published:
    is_good = body["quality"] == "good" and body["value"] is not None
    read_at = body["time"]  # none for what was never read
    time_s = _monotonic(datetime.fromisoformat(read_at).timestamp(), received_s) if read_at else received_s
    return Published(starter, point, float(body["value"]) if is_good else None, received_s, time_s, is_live)


def _monotonic(wall_s: float, received_s: float) -> float:
    """Return a wall-clock time on the monotonic clock; never later than when it was received."""
    return min(received_s, wall_s - time.time() + time.monotonic())

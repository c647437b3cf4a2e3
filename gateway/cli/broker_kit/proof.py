"""Proves on a running broker what its access list does: every login tries every topic, with its own password.

Each login listens to all topics and publishes once on each. What arrives at the login `prover`, which may
read everything, was let through; what arrives at the others, they may read. Then whether some login can
disconnect the gateway by its client id; then last wills, which the broker checks on another way; then a
client without a login.
"""

from __future__ import annotations

import asyncio
import secrets
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gateway.cli.broker_kit.expected import TriedTopic, topics_of
from gateway.cli.broker_kit.logins import PROBE, PROVER, Login, Role
from gateway.config.convert import broker_of
from gateway.config.schema import Config
from gateway.contract import StatusRecord, Topics
from gateway.errors import BrokerError, StartError
from gateway.mqtt import (
    BrokerSettings,
    CommandClient,
    Incoming,
    Message,
    Session,
    SessionParts,
    Version,
    connected,
)

SETTLED_S = 1.0  # so long after the last of it, nothing more arrives
STATUS_WITHIN_S = 1.0

_OF_BROKER = "$SYS/#"
_AT_ONCE = 200  # messages until the broker has taken what was before them


@dataclass(frozen=True, slots=True)
class ProofFinding:
    """What a login may do, or one thing that is wrong."""

    text: str
    is_wrong: bool = False
    count: int = 1  # of probes

    def __str__(self) -> str:
        return f"{'WRONG' if self.is_wrong else 'ok   '} {self.text}"


@dataclass(frozen=True, slots=True)
class Broker:
    """The broker of a configuration, which lies in the folder `place`, and every login's password."""

    config: Config
    place: Path
    passwords: Mapping[str, str]

    def settings(self, login: str | None, *, client_id: str = "", password: str = "") -> BrokerSettings:
        """Return the way to the broker as this login, or without one."""
        return broker_of(
            self.config.mqtt,
            self.place,
            client_id=client_id or login or PROBE,
            username=login,
            password=None if login is None else password or self.passwords[login],
        )


async def prove(broker: Broker, logins: tuple[Login, ...]) -> list[ProofFinding]:
    """Try everything; StartError while the gateway runs, BrokerError when a right login is refused."""
    await _require_no_gateway(broker)
    proof = _Proof(broker, logins)
    try:
        await proof.connect()
        findings = [*await proof.try_topics(), *await proof.try_client_ids()]
        return [*findings, *await proof.try_wills(), *await proof.try_without_login()]
    finally:
        await proof.close()


async def _require_no_gateway(broker: Broker) -> None:
    topics = Topics(broker.config.base)
    prover = CommandClient(broker.settings(PROVER), topics)
    status = await prover.retained(StatusRecord, within_s=STATUS_WITHIN_S)
    if status is not None and status.state != "offline":
        what = "the gateway is running, and the proof needs its login"
        raise StartError(what, "systemctl stop starter-gateway")


class _Proof:
    """The connections of all logins, and what each has received."""

    def __init__(self, broker: Broker, logins: tuple[Login, ...]) -> None:
        self._broker = broker
        self._logins = logins
        self._topics = topics_of(broker.config, logins)
        self._gateway = next(login.name for login in logins if Role.GATEWAY in login.roles)
        self._sessions: dict[str, Session] = {}
        self._version = Version.V5
        self._received: defaultdict[str, set[str]] = defaultdict(set)  # by login: payloads
        self._of_broker: set[str] = set()  # logins that read $SYS
        self._mark = f"acl-probe-{secrets.token_hex(6)}"
        self._sent = 0

    async def connect(self) -> None:
        """Let every login connect and ask for everything; a broker may refuse the asking."""
        for login in self._logins:
            await self._connect(login.name)

    async def close(self) -> None:
        """End every connection."""
        for session in self._sessions.values():
            await session.disconnect()

    async def try_topics(self) -> list[ProofFinding]:
        """Publish as every login on every topic, and return what is wrong, login by login."""
        marks = {}
        for login in self._logins:
            for topic in self._topics:
                if topic.is_real and login.name in topic.writers:
                    continue
                marks[login.name, topic.name] = self._publish(self._sessions[login.name], topic.name)
                if len(marks) % _AT_ONCE == 0:
                    await self._taken()
        await self._taken()
        await asyncio.sleep(SETTLED_S)
        if self._sessions[PROVER].lost.done():
            raise StartError(f"the login {PROVER} was disconnected meanwhile", "one proof at a time")
        return [finding for login in self._logins for finding in self._judged(login, marks)]

    async def try_client_ids(self) -> list[ProofFinding]:
        """Connect as every other login with the gateway's client id: the gateway must stay connected."""
        wrong, count = [], 0
        if self._sessions[self._gateway].lost.done():
            return []  # another program has its login, as was said
        for login in self._logins:
            if login.name == self._gateway:
                continue
            await self._sessions.pop(login.name).disconnect()
            settings = self._broker.settings(login.name, client_id=self._broker.config.client_id)
            try:
                session, _ = await connected(settings)
            except BrokerError:
                continue  # refused, which is as well
            finally:
                count += 1
            await asyncio.wait([self._sessions[self._gateway].lost], timeout=0.2)
            await session.disconnect()
            if self._sessions[self._gateway].lost.done():
                text = f"{login.name} disconnects the gateway by its client id, and receives its commands"
                wrong.append(ProofFinding(text, is_wrong=True))
                await self._connect(self._gateway)
        return wrong or [ProofFinding("no login disconnects the gateway by its client id", count=count)]

    async def try_wills(self) -> list[ProofFinding]:
        """Leave a last will as every login: of the gateway it must arrive, of the others not."""
        await self._connect(PROVER)
        tries = [
            (login.name, topic)
            for login in self._logins
            if login.name != PROVER
            for topic in (self._command_of_others(login), self._topics[0])
        ]
        marks = [await self._leave_will(name, topic.name) for name, topic in tries]
        await asyncio.sleep(SETTLED_S)
        wrong = []
        for (name, topic), mark in zip(tries, marks, strict=True):
            is_through, is_right = mark in self._received[PROVER], name in topic.writers
            if is_through != is_right:
                what = "is published, must be refused" if is_through else "is refused, must be published"
                wrong.append(ProofFinding(f"{name}'s last will with {topic.what}: {what}", is_wrong=True))
        return wrong or [ProofFinding("no login publishes by a last will what it may not", count=len(tries))]

    async def try_without_login(self) -> list[ProofFinding]:
        """Connect without a login, and as the gateway with a wrong password: both must be refused."""
        tries = {
            "without a login": self._broker.settings(None),
            "as the gateway with a wrong password": self._broker.settings(self._gateway, password=self._mark),
        }
        findings = []
        for how, settings in tries.items():
            try:
                session, _ = await connected(settings)
            except BrokerError:
                findings.append(ProofFinding(f"a client {how} is refused"))
            else:
                await session.disconnect()
                findings.append(ProofFinding(f"a client {how} may connect, must be refused", is_wrong=True))
        return findings

    async def _connect(self, name: str) -> None:
        def take(incoming: Incoming) -> None:
            if incoming.topic.startswith("$SYS"):
                self._of_broker.add(name)
            self._received[name].add(incoming.payload.decode("utf-8", "replace"))

        client_id = self._broker.config.client_id if name == self._gateway else ""
        settings = self._broker.settings(name, client_id=client_id)
        session, self._version = await connected(settings, on_incoming=take)
        self._sessions[name] = session
        tried = (topic.name for topic in self._topics if not topic.is_real)
        for wanted in (*tried, "#", f"$share/{name}/#", _OF_BROKER):
            if session.lost.done():
                return
            try:
                await session.subscribe(wanted, with_retained=wanted == _OF_BROKER)
            except BrokerError:
                if not session.lost.done():
                    raise

    def _publish(self, session: Session, topic: str) -> str:
        self._sent += 1
        mark = f"{self._mark} {self._sent}"
        session.publish(self._sent, Message(topic, mark.encode(), qos=1, retain=False))
        return mark

    async def _taken(self) -> None:
        """Wait until the broker has taken everything."""
        for _ in range(100):
            if not any(each.in_flight and not each.lost.done() for each in self._sessions.values()):
                break
            await asyncio.sleep(0.05)

    async def _leave_will(self, name: str, topic: str) -> str:
        """Connect with a last will and vanish; a broker may refuse such a connection."""
        if name in self._sessions:
            await self._sessions.pop(name).disconnect()
        self._sent += 1
        mark = f"{self._mark} {self._sent}"
        will = Message(topic, mark.encode(), qos=1, retain=False)
        parts = SessionParts(will, lambda _: None, lambda _, __: None)
        session = Session(self._broker.settings(name), self._version, parts)
        with suppress(BrokerError):
            await session.connect()
        session.abort()
        return mark

    def _command_of_others(self, login: Login) -> TriedTopic:
        """Return a topic of commands that are not this login's."""
        return next(
            topic
            for topic in self._topics
            if f"{self._broker.config.base}/command/" in topic.name and login.name not in topic.writers
        )

    def _judged(self, login: Login, marks: Mapping[tuple[str, str], str]) -> Iterator[ProofFinding]:
        """Yield what is wrong with a login; else what it may do."""
        if self._sessions[login.name].lost.done():
            text = f"{login.name} was disconnected while it was tried: end the program that has its login"
            yield ProofFinding(text, is_wrong=True)
            return
        right: dict[str, list[str]] = {"writes": [], "reads": []}
        wrong = []
        if login.name in self._of_broker:
            wrong.append("reads $SYS: must be refused")
        for topic in self._topics:
            if (login.name, topic.name) not in marks:
                continue
            is_through = marks[login.name, topic.name] in self._received[PROVER]
            if is_through != (login.name in topic.writers):
                wrong.append(f"writes {topic.what}: {_said(is_allowed=is_through)}")
            elif is_through:
                right["writes"].append(topic.what)
            of_others = {marks.get((each, topic.name)) for each in topic.writers} & self._received[PROVER]
            is_seen = bool(of_others & self._received[login.name])
            if of_others and is_seen != (login.name in topic.readers):
                wrong.append(f"reads {topic.what}: {_said(is_allowed=is_seen)}")
            elif is_seen:
                right["reads"].append(topic.what)
        if wrong:
            found = dict.fromkeys(wrong)
            yield from (ProofFinding(f"{login.name} {text}", is_wrong=True) for text in found)
            return
        does = "; ".join(
            f"{verb} {', '.join(dict.fromkeys(what)) or 'nothing'}" for verb, what in right.items()
        )
        tried = sum(name == login.name for name, _ in marks)
        yield ProofFinding(f"{login.name} {does}", count=2 * tried + 1)


def _said(*, is_allowed: bool) -> str:
    return "is allowed, must be refused" if is_allowed else "is refused, must be allowed"

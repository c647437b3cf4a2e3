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
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gateway.cli.broker_kit.logins import PROVER, KitSettings, Login, TriedTopic, tried_topics
from gateway.cli.broker_kit.rights import PROBE
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
class Proved:
    """The outcome of some probes: what a login may do, or one thing that is wrong."""

    text: str
    is_wrong: bool = False
    count: int = 1  # of probes

    def __str__(self) -> str:
        return f"{'WRONG' if self.is_wrong else 'ok   '} {self.text}"


class BrokerProof:
    """The connections of all logins, and what each has received; `place` is the configuration's folder."""

    def __init__(
        self,
        config: Config,
        place: Path,
        settings: KitSettings,
        logins: tuple[Login, ...],
        passwords: Mapping[str, str],
    ) -> None:
        self._config = config
        self._place = place
        self._logins = logins
        self._passwords = passwords
        self._topics = tried_topics(config, settings, logins)
        self._gateway = logins[0].name
        self._sessions: dict[str, Session] = {}
        self._version = Version.V5
        self._received: defaultdict[str, set[str]] = defaultdict(set)  # by login: payloads, and $SYS
        self._mark = f"{PROBE}-{secrets.token_hex(6)}"
        self._sent = 0

    async def run(self) -> list[Proved]:
        """Try everything; StartError while the gateway runs, BrokerError when a right login is refused."""
        asking = CommandClient(self._way(PROVER), Topics(self._config.base))
        status = await asking.retained(StatusRecord, within_s=STATUS_WITHIN_S)
        if status is not None and status.state != "offline":
            what = "the gateway is running, and the proof needs its login"
            raise StartError(what, "systemctl stop starter-gateway")
        try:
            for login in self._logins:
                await self._connect(login.name)
            return [
                *await self._try_topics(),
                *await self._try_client_ids(),
                *await self._try_wills(),
                *await self._try_without_login(),
            ]
        finally:
            for session in self._sessions.values():
                await session.disconnect()

    async def _try_topics(self) -> list[Proved]:
        """Publish as every login on every topic, and return what is wrong, login by login."""
        marks = {}
        for login in self._logins:
            for topic in self._topics:
                if topic.is_real and login.name in topic.writers:
                    continue
                marks[login.name, topic.name] = message = self._probe(topic)
                self._sessions[login.name].publish(self._sent, message)
                if len(marks) % _AT_ONCE == 0:
                    await self._taken()
        await self._taken()
        await asyncio.sleep(SETTLED_S)
        if self._sessions[PROVER].lost.done():
            raise StartError(f"the login {PROVER} was disconnected meanwhile", "one proof at a time")
        texts = {key: message.payload.decode() for key, message in marks.items()}
        return [finding for login in self._logins for finding in self._judged(login.name, texts)]

    async def _try_client_ids(self) -> Iterable[Proved]:
        """Connect as every other login with the gateway's client id: the gateway must stay connected."""
        if self._sessions[self._gateway].lost.done():
            return ()  # another program has its login, as was said
        wrong, others = [], [login.name for login in self._logins if login.name != self._gateway]
        for name in others:
            await self._sessions.pop(name).disconnect()
            try:
                session, _ = await connected(self._way(name, client_id=self._config.client_id))
            except BrokerError:
                continue  # refused, which is as well
            await asyncio.wait([self._sessions[self._gateway].lost], timeout=0.2)
            await session.disconnect()
            if self._sessions[self._gateway].lost.done():
                wrong.append(f"{name} disconnects the gateway by its client id, and receives its commands")
                await self._connect(self._gateway)
        return _proved(wrong, "no login disconnects the gateway by its client id", len(others))

    async def _try_wills(self) -> Iterable[Proved]:
        """Leave a last will as every login: of the gateway it must arrive, of the others not."""
        await self._connect(PROVER)
        commands = [each for each in self._topics if f"{self._config.base}/command/" in each.name]
        tries = [
            (login.name, topic, self._probe(topic))
            for login in self._logins
            if login.name != PROVER
            for topic in (next(each for each in commands if login.name not in each.writers), self._topics[0])
        ]
        for name, _, will in tries:
            if name in self._sessions:
                await self._sessions.pop(name).disconnect()
            parts = SessionParts(will, lambda _: None, lambda _, __: None)
            session = Session(self._way(name), self._version, parts)
            with suppress(BrokerError):  # a broker may refuse such a connection
                await session.connect()
            session.abort()
        await asyncio.sleep(SETTLED_S)
        wrong = []
        for name, topic, will in tries:
            is_through, is_right = will.payload.decode() in self._received[PROVER], name in topic.writers
            if is_through != is_right:
                what = "is published, must be refused" if is_through else "is refused, must be published"
                wrong.append(f"{name}'s last will with {topic.what}: {what}")
        return _proved(wrong, "no login publishes by a last will what it may not", len(tries))

    async def _try_without_login(self) -> list[Proved]:
        """Connect without a login, and as the gateway with a wrong password: both must be refused."""
        tries = {
            "without a login": self._way(None),
            "as the gateway with a wrong password": self._way(self._gateway, password=self._mark),
        }
        findings: list[Proved] = []
        for how, settings in tries.items():
            try:
                session, _ = await connected(settings)
            except BrokerError:
                findings.append(Proved(f"a client {how} is refused"))
            else:
                await session.disconnect()
                findings.append(Proved(f"a client {how} may connect, must be refused", is_wrong=True))
        return findings

    def _way(self, login: str | None, *, client_id: str = "", password: str = "") -> BrokerSettings:
        """Return the way to the broker as this login, or without one."""
        return broker_of(
            self._config.mqtt,
            self._place,
            client_id=client_id or login or PROBE,
            username=login,
            password=None if login is None else password or self._passwords[login],
        )

    async def _connect(self, name: str) -> None:
        """Let a login connect and ask for everything; a broker may refuse the asking."""

        def take(incoming: Incoming) -> None:
            is_of_broker = incoming.topic.startswith("$SYS")
            text = _OF_BROKER if is_of_broker else incoming.payload.decode("utf-8", "replace")
            self._received[name].add(text)

        client_id = self._config.client_id if name == self._gateway else ""
        session, self._version = await connected(self._way(name, client_id=client_id), on_incoming=take)
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

    def _probe(self, topic: TriedTopic) -> Message:
        self._sent += 1
        return Message(topic.name, f"{self._mark} {self._sent}".encode(), qos=1, retain=False)

    async def _taken(self) -> None:
        """Wait until the broker has taken everything."""
        for _ in range(100):
            if not any(each.in_flight and not each.lost.done() for each in self._sessions.values()):
                break
            await asyncio.sleep(0.05)

    def _judged(self, login: str, marks: Mapping[tuple[str, str], str]) -> Iterator[Proved]:
        """Yield what is wrong with a login; else what it may do."""
        if self._sessions[login].lost.done():
            text = f"{login} was disconnected while it was tried: end the program that has its login"
            yield Proved(text, is_wrong=True)
            return
        right: dict[str, list[str]] = {"writes": [], "reads": []}
        wrong = ["reads $SYS: must be refused"] if _OF_BROKER in self._received[login] else []
        tried = [topic for topic in self._topics if (login, topic.name) in marks]
        for topic in tried:
            of_others = {marks.get((each, topic.name)) for each in topic.writers} & self._received[PROVER]
            is_through = marks[login, topic.name] in self._received[PROVER]
            is_seen = bool(of_others & self._received[login])
            for verb, is_allowed, may in (
                ("writes", is_through, login in topic.writers),
                ("reads", is_seen, login in topic.readers if of_others else is_seen),
            ):
                if is_allowed != may:
                    said = "is allowed, must be refused" if is_allowed else "is refused, must be allowed"
                    wrong.append(f"{verb} {topic.what}: {said}")
                elif is_allowed:
                    right[verb].append(topic.what)
        if wrong:
            yield from (Proved(f"{login} {text}", is_wrong=True) for text in dict.fromkeys(wrong))
            return
        does = "; ".join(
            f"{verb} {', '.join(dict.fromkeys(what)) or 'nothing'}" for verb, what in right.items()
        )
        yield Proved(f"{login} {does}", count=2 * len(tried) + 1)


def _proved(wrong: list[str], right: str, count: int) -> list[Proved]:
    return [Proved(text, is_wrong=True) for text in wrong] or [Proved(right, count=count)]

"""Proves on a running broker what its access list does: every login tries every topic, with its own password.

Each login listens to all topics and publishes once on each. A message that arrives at the login `prover`,
which may read everything, was let through; a message that arrives at another login, that login may read. Then
whether some login can disconnect the gateway by its client id; then last wills, which the broker checks on
another way; then a client without a login.
"""

from __future__ import annotations

import asyncio
import secrets
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from gateway.cli.broker_kit.logins import PROVER
from gateway.cli.broker_kit.rights import PROBE, Login, TriedTopic, tried_topics
from gateway.cli.doctor.findings import Finding
from gateway.config import Config, broker_of
from gateway.contract import StatusRecord, Topics
from gateway.errors import BrokerError, StartError
from gateway.families import Weight
from gateway.mqtt import (
    BrokerSettings,
    CommandClient,
    Incoming,
    Message,
    Session,
    SessionParts,
    connected,
)

SETTLED_S = 1.0  # so long after the last of it, nothing more arrives
STATUS_WITHIN_S = 1.0

_OF_BROKER = "$SYS/#"
_AT_ONCE = 200  # messages until the broker has taken what was before them


class BrokerProof:
    """The connections of all logins, and what was found; `place` is the configuration's folder."""

    def __init__(self, config: Config, place: Path, logins: Sequence[Login]) -> None:
        self._config = config
        self._place = place
        self._topics = tried_topics(config, logins)
        self._logins = {login.name: login for login in logins}
        self._gateway = logins[0].name
        self._sessions: dict[str, Session] = {}
        self._received: defaultdict[str, set[bytes | str]] = defaultdict(set)  # by login: payloads, and $SYS
        self._mark = f"{PROBE}-{secrets.token_hex(6)}"
        self._found: defaultdict[str, dict[Finding, None]] = defaultdict(dict)  # by login

    async def run(self) -> None:
        """Try everything; StartError while the gateway runs, BrokerError when a right login is refused."""
        asking = CommandClient(self._way(PROVER), Topics(self._config.base))
        status = await asking.retained(StatusRecord, within_s=STATUS_WITHIN_S)
        if status is not None and status.state != "offline":
            what = "the gateway is running, and the proof needs its login"
            raise StartError(what, "systemctl stop starter-gateway")
        try:
            for name in self._logins:
                await self._connect(name)
            await self._try_topics()
            await self._try_client_ids()
            await self._try_wills()
            await self._try_without_login()
        finally:
            for session in self._sessions.values():
                await session.disconnect()

    def findings(self) -> Iterator[Finding]:
        """Yield what is wrong with each login; else in one line what it may do."""
        for name, found in self._found.items():
            wrong = [finding for finding in found if finding.weight is not None]
            said = ", ".join(finding.text for finding in found)
            yield from wrong or [Finding(name, said or "may do nothing")]

    def _judge(self, login: str, text: str, *, is_done: bool, may: bool) -> None:
        """Note whether a login did what it must, or what it must not."""
        wrong = () if is_done is may else (Weight.ERROR, "must be allowed" if may else "must be refused")
        self._found[login] |= {Finding(login, text, *wrong): None} if wrong or may else {}

    async def _try_topics(self) -> None:
        """Publish as every login on every topic, and judge login by login."""
        tries = [(name, topic) for name in self._logins for topic in self._topics if name in topic.triers]
        for number, (name, topic) in enumerate(tries):
            self._sessions[name].publish(number, self._probe(name, topic))
            if number % _AT_ONCE == 0:
                await self._taken()
        await self._taken()
        await asyncio.sleep(SETTLED_S)
        arrived = self._received[PROVER]
        for name in self._logins:
            if self._sessions[name].lost.done():
                text = "was disconnected while it was tried: end the program that has its login"
                self._judge(name, text, is_done=True, may=False)
                continue
            seen = self._received[name]
            self._judge(name, "reads $SYS", is_done=_OF_BROKER in seen, may=False)
            for topic in self._topics:
                if name in topic.triers:
                    is_done = self._probe(name, topic).payload in arrived
                    self._judge(name, f"writes {topic.what}", is_done=is_done, may=name in topic.writers)
                of_writers = {self._probe(writer, topic).payload for writer in topic.writers & topic.triers}
                if of_writers := of_writers & arrived:  # else there is nothing to be read
                    is_done = bool(of_writers & seen)
                    self._judge(name, f"reads {topic.what}", is_done=is_done, may=name in topic.readers)

    async def _try_client_ids(self) -> None:
        """Connect as every other login with the gateway's client id: its own connection must survive."""
        for name in [name for name in self._logins if name != self._gateway]:
            with suppress(BrokerError):  # a broker may refuse the id
                session = await connected(self._way(name, client_id=self._config.client_id))
                await asyncio.wait([self._sessions[self._gateway].lost], timeout=0.2)
                await session.disconnect()
            is_done = self._sessions[self._gateway].lost.done()
            text = "disconnects the gateway by its client id, and receives its commands"
            self._judge(name, text, is_done=is_done, may=False)
            if is_done:
                await self._connect(self._gateway)

    async def _try_wills(self) -> None:
        """Leave a last will as every login: of the gateway it must arrive, of the others not."""
        await self._connect(PROVER)
        commands = [topic for topic in self._topics if f"{self._config.base}/command/" in topic.name]
        tries = [
            (name, topic, self._probe(name, topic, by="will"))
            for name in self._logins
            if name != PROVER
            for topic in (next(other for other in commands if name not in other.writers), self._topics[0])
        ]
        for name, _, will in tries:
            with suppress(BrokerError):  # a broker may refuse such a connection
                (await connected(self._way(name), SessionParts(will))).abort()
        await asyncio.sleep(SETTLED_S)
        for name, topic, will in tries:
            is_done = will.payload in self._received[PROVER]
            text = f"publishes {topic.what} by a last will"
            self._judge(name, text, is_done=is_done, may=name in topic.writers)

    async def _try_without_login(self) -> None:
        """Connect without a login, and as the gateway with a wrong password: both must be refused."""
        for login, who in ((None, "a client without a login"), (self._gateway, "a wrong password")):
            is_done = False
            with suppress(BrokerError):
                session = await connected(self._way(login, password=self._mark))
                await session.disconnect()
                is_done = True
            self._judge(who, "may connect", is_done=is_done, may=False)

    def _way(self, login: str | None, *, client_id: str = "", password: str = "") -> BrokerSettings:
        """Return the way to the broker as this login, or without one."""
        return broker_of(
            self._config.mqtt,
            self._place,
            client_id=client_id or login or PROBE,
            username=login,
            password=None if login is None else password or self._logins[login].password,
        )

    async def _connect(self, name: str) -> None:
        """Let a login connect and ask for everything, also by its names: a broker may refuse `#`."""
        client_id = self._config.client_id if name == self._gateway else ""
        parts = SessionParts(on_incoming=partial(self._take, name))
        session = await connected(self._way(name, client_id=client_id), parts)
        self._sessions[name] = session
        tried = (topic.name for topic in self._topics if topic.triers & topic.writers)
        for wanted in (*tried, *self._logins[name].reads, "#", f"$share/{name}/#", _OF_BROKER):
            if session.lost.done():
                return
            try:
                await session.subscribe(wanted, with_retained=wanted == _OF_BROKER)
            except BrokerError:
                if not session.lost.done():
                    raise

    def _take(self, name: str, incoming: Incoming) -> None:
        is_of_broker = incoming.topic.startswith("$SYS")
        self._received[name].add(_OF_BROKER if is_of_broker else incoming.payload)

    def _probe(self, name: str, topic: TriedTopic, *, by: str = "") -> Message:
        """Return the message that a login publishes on a topic; no other has its payload."""
        return Message(topic.name, f"{self._mark} {name} {topic.name} {by}".encode(), qos=1, retain=False)

    async def _taken(self) -> None:
        """Wait until the broker has taken everything."""
        for _ in range(100):
            if not any(session.in_flight and not session.lost.done() for session in self._sessions.values()):
                break
            await asyncio.sleep(0.05)

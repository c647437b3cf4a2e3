"""The page's streams: server-sent events, the newest state for each client at its own pace.

A client has no queue: it is known how far it has been sent everything, and it gets what is newer, at most
every 250 ms. One that reads slowly skips what lies between; one that has missed messages gets the whole
again. JSON is made when it is sent.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from starlette.types import Receive, Send

from gateway import __version__
from gateway.contract import CONTRACT_VERSION, Record, encoded, rfc3339
from gateway.plugins.interface import Gateway
from gateway.plugins.web.accounts import Accounts, WebSession
from gateway.plugins.web.control import Control
from gateway.plugins.web.site_model import Seen, SiteModel
from gateway.system.supervised import until_first

EVERY_S = 0.25  # between two batches
AT_ONCE_S = 0.02  # after a quiet time: what changes together goes together
BEAT_S = 1.0  # a page that has had none for 3 s says that it is not live; ages and actions as often
RETRY_MS = 2000
MOST_STREAMS = 48  # of the server's connections; the others are for requests
PIECE_BYTES = 32_768  # of a snapshot; the next is made when the client has taken most of the last
PAUSE_BYTES = 2048  # after so many, whatever else waits on the loop comes first: a stop above all


@dataclass(slots=True, eq=False)
class Stream:
    """One client of the stream."""

    scope: str | None  # a starter, of which it gets everything
    owner: str  # session, or address without one
    session: WebSession | None = None
    seen: Seen | None = None  # sent so far; None: a snapshot is due
    actions: bytes = b""  # as sent last
    actions_due_s: float = 0.0
    sent_s: float = 0.0  # when something was sent last
    ages_due_s: float = 0.0
    is_over: bool = False
    wake: asyncio.Event = field(default_factory=asyncio.Event)


class Streams:
    """All streams that are open; on the application's loop."""

    def __init__(self, model: SiteModel, control: Control, accounts: Accounts, gateway: Gateway) -> None:
        self._model = model
        self._control = control
        self._accounts = accounts
        self._gateway = gateway
        self._clock = gateway.clock
        self._streams: set[Stream] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._ticked_s = 0.0
        self._cached: tuple[tuple[str | None, Seen, Seen], bytes] | None = None

    def __len__(self) -> int:
        return len(self._streams)

    def join(self, stream: Stream, *, most_of_owner: int) -> str:
        """Add a stream; return why not when too many are open, of all or of this owner."""
        of_owner = sum(each.owner == stream.owner for each in self._streams)
        if of_owner >= most_of_owner:
            number = f"{of_owner} of {most_of_owner}"
            return f"too many pages are open here ({number}): close one, or raise pages_per_address in [web]"
        if len(self._streams) >= MOST_STREAMS:
            return f"too many pages are open ({MOST_STREAMS} of {MOST_STREAMS}): close one"
        self._streams.add(stream)
        return ""

    async def serve(self, stream: Stream, receive: Receive, send: Send) -> None:
        """Send events until the client has gone, the login ends or the page does."""
        try:
            await until_first(_until_gone(receive), self._send_all(stream, send))
        finally:
            self._streams.discard(stream)

    def note_change(self) -> None:
        """Send what is new soon; called after every change of the model."""
        if self._timer is None and self._streams:
            loop = asyncio.get_running_loop()
            delay_s = max(AT_ONCE_S, self._ticked_s + EVERY_S - loop.time())
            self._timer = loop.call_later(delay_s, self._tick)

    def restart(self) -> None:
        """Send the whole to every client: the configuration has changed."""
        for stream in self._streams:
            stream.seen = None
            stream.wake.set()

    def end(self, session: WebSession | None = None) -> None:
        """End the streams of a session, or all."""
        for stream in self._streams:
            if session is None or stream.session is session:
                stream.is_over = True
                stream.wake.set()

    def snapshot(self, stream: Stream) -> Iterator[bytes]:
        """Yield the whole as one JSON object."""
        model, settings, scope = self._model, self._model.settings, stream.scope
        stream.seen = model.now
        stream.actions = self._actions(stream)
        about = {
            "version": __version__,
            "contract": CONTRACT_VERSION,
            "gateway": settings.config.gateway.name,
            "base": settings.config.base,
            "scope": scope,
            "session": self._accounts.as_data(stream.session),
            "lines": settings.lines,
            "groups": settings.groups,
        }
        yield b"{" + self._head(stream) + b"," + encoded(about)[1:-1] + b',"starters":{'
        yield from _joined(_pair(name, encoded(model.facts(name))) for name in settings.starters)
        yield b'},"topics":{'
        yield from _joined(topic_pair(*each) for each in model.topics(scope))
        yield b'},"messages":['
        yield from _joined(_message(each) for each in model.messages(scope) or ())
        yield b'],"actions":' + (stream.actions or b"null") + b"}"

    def _pieces(self, stream: Stream) -> Iterator[bytes]:
        """Yield what the client is to be sent now: a snapshot, a change or a beat."""
        changed = None if stream.seen is None else self._changed(stream.scope, stream.seen)
        if changed is None:
            stream.sent_s = self._clock.now_s()  # so that the next beat is due later
            yield b"event: snapshot\ndata: "
            yield from self.snapshot(stream)
            yield b"\n\n"
            return
        stream.seen = self._model.now
        actions = self._actions(stream)
        is_new = actions != stream.actions
        stream.actions = actions
        is_beat, now_s = not changed and not is_new, self._clock.now_s()
        if is_beat and now_s - stream.sent_s < BEAT_S / 2:
            return
        stream.sent_s = now_s
        head = self._head(stream)
        if is_beat:
            yield b"event: beat\ndata: {" + head + b"}\n\n"
            return
        more = b',"actions":' + actions if is_new else b""
        content = changed or b'"topics":{},"messages":[]'
        yield b"event: change\ndata: {" + head + b"," + content + more + b"}\n\n"

    def _head(self, stream: Stream) -> bytes:
        """Return what every event begins with; once a second with the ages of the starters' last replies."""
        now_s, utc_s = self._clock.now_s(), self._clock.utc_s()
        gen = 0 if stream.seen is None else stream.seen.gen
        head: dict[str, Any] = {"gen": gen, "time": rfc3339(utc_s), "token": self._control.token()}
        if now_s >= stream.ages_due_s:
            stream.ages_due_s = now_s + BEAT_S - EVERY_S / 2
            head["ages"] = [self._age_s(name, utc_s) for name in self._model.settings.starters]
        return encoded(head)[1:-1]

    def _age_s(self, starter: str, utc_s: float) -> float | None:
        """Return the time since a starter's last reply."""
        view = self._gateway.starters.get(starter)
        answered_s = None if view is None else view.snapshot.last_s()
        return None if answered_s is None else max(round(utc_s - answered_s, 1), 0.0)

    def _changed(self, scope: str | None, since: Seen) -> bytes | None:
        """Return what has changed for a client; empty for nothing, None when messages are lost.

        Made once for all clients that have seen the same.
        """
        model = self._model
        key = scope, since, model.now
        if self._cached is not None and self._cached[0] == key:
            return self._cached[1]
        messages = model.messages(scope, since.happened)
        if messages is None:
            return None
        topics = model.topics(scope, since.latest)
        facts = model.facts_since(since)
        content = b""
        if topics or messages or facts:
            content = b'"topics":{' + b",".join(topic_pair(*each) for each in topics)
            content += b'},"messages":[' + b",".join(map(_message, messages)) + b"]"
            content += b',"starters":' + encoded(facts) if facts else b""
        self._cached = key, content
        return content

    def _actions(self, stream: Stream) -> bytes:
        """Return what is permitted, looked at once in a while; empty where no starter is in scope."""
        now_s = self._clock.now_s()
        if stream.scope is None or (stream.actions and now_s < stream.actions_due_s):
            return stream.actions
        stream.actions_due_s = now_s + BEAT_S
        client = stream.session.user.client if stream.session else None
        return encoded(self._control.actions(stream.scope, client))

    def _tick(self) -> None:
        self._timer = None
        self._ticked_s = asyncio.get_running_loop().time()
        for stream in self._streams:
            stream.wake.set()

    async def _send_all(self, stream: Stream, send: Send) -> None:
        headers = [
            (b"content-type", b"text/event-stream; charset=utf-8"),
            (b"cache-control", b"no-store"),
            (b"x-accel-buffering", b"no"),
        ]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await _send_pieces(send, [b"retry: %d\n\n" % RETRY_MS])
        while not stream.is_over and not self._is_logged_out(stream):
            await _send_pieces(send, self._pieces(stream))
            await self._wait(stream)
        if self._is_logged_out(stream):
            await _send_pieces(send, [b'event: session\ndata: {"user":null}\n\n'])
        await send({"type": "http.response.body", "body": b"", "more_body": False})

    async def _wait(self, stream: Stream) -> None:
        """Wait until the stream is woken; for a beat at most."""
        with suppress(TimeoutError):
            async with asyncio.timeout(BEAT_S):
                await stream.wake.wait()
            stream.wake.clear()

    def _is_logged_out(self, stream: Stream) -> bool:
        """Return whether the login that a stream was opened with has ended."""
        return stream.session is not None and not self._accounts.is_logged_in(stream.session)


async def unhurried(pieces: Iterable[bytes]) -> AsyncIterator[bytes]:
    """Yield pieces; between them whatever else waits on the loop is done."""
    size = 0
    for piece in pieces:
        yield piece
        size += len(piece)
        if size >= PAUSE_BYTES:
            size = 0
            await asyncio.sleep(0)


async def _send_pieces(send: Send, pieces: Iterator[bytes] | list[bytes]) -> None:
    buffer = bytearray()
    async for piece in unhurried(pieces):
        buffer += piece
        if len(buffer) >= PIECE_BYTES:
            await send({"type": "http.response.body", "body": bytes(buffer), "more_body": True})
            buffer.clear()
    if buffer:
        await send({"type": "http.response.body", "body": bytes(buffer), "more_body": True})


async def _until_gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


def topic_pair(topic: str, record: Record | None) -> bytes:
    """Return a topic with its payload, as in a JSON object; null for one that is gone."""
    return _pair(topic, b"null" if record is None else record.payload())


def _pair(name: str, payload: bytes) -> bytes:
    return encoded(name) + b":" + payload


def _message(record: Record) -> bytes:
    return b'{"topic":' + encoded(record.topic) + b',"payload":' + record.payload() + b"}"


def _joined(items: Iterator[bytes]) -> Iterator[bytes]:
    separator = b""
    for item in items:
        yield separator + item
        separator = b","

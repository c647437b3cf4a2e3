"""The page's streams: server-sent events, the newest state for each client at its own pace.

A client has no queue: it has the generation that it was sent last, and gets what is newer, at most every
250 ms. One that reads slowly skips what lies between; one that has missed messages gets the whole again.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from dataclasses import dataclass, field

from starlette.types import Receive, Scope, Send

from gateway.contract import rfc3339
from gateway.plugins.web.interface import GatewayAccess, dumps
from gateway.plugins.web.site_model import SiteModel
from gateway.system.clock import Clock
from gateway.system.supervised import until_first

EVERY_S = 0.25  # between two batches
AT_ONCE_S = 0.02  # after a quiet time: what changes together goes together
BEAT_S = 5.0
ACTIONS_S = 1.0  # between two looks at what is permitted
RETRY_MS = 2000
MOST_STREAMS = 48  # of the server's connections; the others are for requests
PIECE_BYTES = 32_768  # of a snapshot; the next is made when the client has taken most of the last
PAUSE_BYTES = 2048  # after so many, whatever else waits on the loop comes first: a stop above all


@dataclass(slots=True, eq=False)
class Stream:
    """One client of the stream."""

    scope: str | None  # a starter, of which it gets everything
    owner: str  # session, or address without one
    session: bytes  # JSON
    session_key: str = ""
    client: str | None = None  # the operator
    gen: int = 0  # sent so far; 0: a snapshot is due
    actions: bytes = b""  # as sent last
    actions_now: bytes = b""  # as looked at last
    actions_due_s: float = 0.0
    sent_s: float = 0.0  # when something was sent last
    is_over: bool = False
    wake: asyncio.Event = field(default_factory=asyncio.Event)


class Streams:
    """All streams that are open; on the application's loop."""

    def __init__(
        self,
        model: SiteModel,
        access: GatewayAccess,
        clock: Clock,
        *,
        is_logged_in: Callable[[str], bool],
    ) -> None:
        self.model = model
        self._access = access
        self._clock = clock
        self._is_logged_in = is_logged_in
        self._streams: set[Stream] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._ticked_s = 0.0
        self._cached: tuple[tuple[str | None, int, int], bytes] | None = None

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

    def leave(self, stream: Stream) -> None:
        """Remove a stream."""
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
            stream.gen = 0
            stream.wake.set()

    def end(self, session_key: str | None = None) -> None:
        """End the streams of a session, or all."""
        for stream in self._streams:
            if session_key is None or stream.session_key == session_key:
                stream.is_over = True
                stream.wake.set()

    def pieces(self, stream: Stream) -> Iterator[bytes]:
        """Yield what the client is to be sent now: a snapshot, a change or a beat."""
        if stream.gen == 0:
            yield from self._snapshot(stream)
            return
        since, stream.gen = stream.gen, self.model.gen
        changed = self._changed(stream.scope, since)
        if changed is None:
            yield from self._snapshot(stream)
            return
        actions = self._actions(stream)
        is_new = actions != stream.actions
        stream.actions = actions
        is_beat, now_s = not changed and not is_new, self._clock.now_s()
        if is_beat and now_s - stream.sent_s < BEAT_S - ACTIONS_S / 2:
            return
        stream.sent_s = now_s
        if is_beat:
            yield b"event: beat\ndata: {" + self._head() + b"}\n\n"
            return
        more = b',"actions":' + actions if is_new else b""
        content = changed or b'"topics":{},"messages":[]'
        yield b"event: change\ndata: {" + self._head() + b"," + content + more + b"}\n\n"

    def is_due(self, stream: Stream) -> bool:
        """Return whether something has changed for a client, apart from the time."""
        if stream.gen != self.model.gen or stream.is_over:
            return True
        return self._actions(stream) != stream.actions

    def is_ended(self, stream: Stream) -> bool:
        """Return whether a stream must end: its login has, or the page does."""
        return stream.is_over or self.is_logged_out(stream)

    def is_logged_out(self, stream: Stream) -> bool:
        """Return whether the login that a stream was opened with has ended."""
        return bool(stream.session_key) and not self._is_logged_in(stream.session_key)

    def snapshot(self, stream: Stream) -> Iterator[bytes]:
        """Yield the whole as one JSON object."""
        model, site, scope = self.model, self.model.site, stream.scope
        stream.gen = model.gen
        stream.actions = self._actions(stream)
        about = {
            "version": site.version,
            "contract": site.contract,
            "gateway": site.gateway,
            "base": site.base,
            "scope": scope,
        }
        yield b"{" + self._head() + b"," + dumps(about)[1:-1] + b',"session":' + stream.session
        yield b',"lines":' + dumps(site.lines) + b',"groups":' + dumps(site.groups)
        yield b',"starters":{'
        yield from _joined(_pair(name, dumps(model.facts(name))) for name in tuple(site.starters))
        yield b'},"topics":{'
        yield from _joined(_pair(name, payload or b"null") for name, payload in model.later(scope))
        yield b'},"messages":['
        yield from _joined(_message(m.place.name, m.payload) for m in model.messages(scope) or ())
        yield b'],"actions":' + (stream.actions or b"null") + b"}"

    def _snapshot(self, stream: Stream) -> Iterator[bytes]:
        stream.sent_s = self._clock.now_s()  # so that the next beat is due later
        yield b"event: snapshot\ndata: "
        yield from self.snapshot(stream)
        yield b"\n\n"

    def _head(self) -> bytes:
        head = {"gen": self.model.gen, "time": rfc3339(self._clock.utc_s()), "token": self._access.token()}
        return dumps(head)[1:-1]

    def _changed(self, scope: str | None, since: int) -> bytes | None:
        """Return what has changed since a generation; empty for nothing, None when messages are lost.

        Made once for all clients that have seen the same.
        """
        key = scope, since, self.model.gen
        if self._cached is not None and self._cached[0] == key:
            return self._cached[1]
        messages = self.model.messages(scope, since)
        if messages is None:
            return None
        topics = [
            _pair(name, b"null" if payload is None else payload)
            for name, payload in self.model.topics(scope, since)
        ]
        facts = self.model.facts_since(since)
        content = b""
        if topics or messages or facts:
            happened = b",".join(_message(each.place.name, each.payload) for each in messages)
            content = b'"topics":{' + b",".join(reversed(topics)) + b'},"messages":[' + happened + b"]"
            content += b',"starters":' + dumps(facts) if facts else b""
        self._cached = key, content
        return content

    def _actions(self, stream: Stream) -> bytes:
        """Return what is permitted, looked at once in a while; empty where no starter is in scope."""
        now_s = self._clock.now_s()
        if stream.scope is not None and (now_s >= stream.actions_due_s or not stream.actions_now):
            stream.actions_due_s = now_s + ACTIONS_S
            stream.actions_now = dumps(self._access.actions(stream.scope, stream.client))
        return stream.actions_now

    def _tick(self) -> None:
        self._timer = None
        self._ticked_s = asyncio.get_running_loop().time()
        for stream in self._streams:
            stream.wake.set()


class EventStream:
    """One answer that goes on until the client leaves; an ASGI application."""

    def __init__(self, streams: Streams, stream: Stream) -> None:
        self._streams = streams
        self._stream = stream

    async def __call__(self, _scope: Scope, receive: Receive, send: Send) -> None:
        """Send events until the client has gone, the login ends or the page does."""
        try:
            await until_first(_until_gone(receive), self._send_all(send))
        finally:
            self._streams.leave(self._stream)

    async def _send_all(self, send: Send) -> None:
        headers = [
            (b"content-type", b"text/event-stream; charset=utf-8"),
            (b"cache-control", b"no-store"),
            (b"x-accel-buffering", b"no"),
        ]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await _send_pieces(send, [b"retry: %d\n\n" % RETRY_MS])
        stream = self._stream
        while not self._streams.is_ended(stream):
            await _send_pieces(send, self._streams.pieces(stream))
            await self._wait()
        if self._streams.is_logged_out(stream):
            await _send_pieces(send, [b'event: session\ndata: {"user":null}\n\n'])
        await send({"type": "http.response.body", "body": b"", "more_body": False})

    async def _wait(self) -> None:
        stream, streams = self._stream, self._streams
        waits_s = BEAT_S if stream.scope is None else ACTIONS_S
        for _ in range(round(BEAT_S / waits_s)):
            try:
                async with asyncio.timeout(waits_s):
                    await stream.wake.wait()
            except TimeoutError:
                if streams.is_due(stream) or streams.is_ended(stream):
                    return
            else:
                stream.wake.clear()
                return


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


def _pair(name: str, payload: bytes) -> bytes:
    return dumps(name) + b":" + payload


def _message(topic: str, payload: bytes) -> bytes:
    return b'{"topic":' + dumps(topic) + b',"payload":' + payload + b"}"


def _joined(items: Iterator[bytes]) -> Iterator[bytes]:
    separator = b""
    for item in items:
        yield separator + item
        separator = b","

"""The listening socket and its connections: bounded in number, size and time.

uvicorn's HTTP/1.1 protocol (h11) on connections that are accepted here, so that even a handshake counts.
Once a second each is looked at: one that sends no whole request, or takes nothing, or idles is aborted.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
from collections.abc import Callable
from typing import Any

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from gateway.plugins.web.plugin import WebSettings
from gateway.plugins.web.requests import MAX_HEADER_BYTES
from gateway.system.key_pair import load_key_pair

log = logging.getLogger(__name__)

MOST_CONNECTIONS = 64
REQUEST_WITHIN_S = 10.0  # its head and its body
IDLE_S = 30.0  # between two requests
WRITE_WITHIN_S = 15.0  # a client that takes nothing of what waits for it
HANDSHAKE_WITHIN_S = 5.0
LOOK_S = 1.0
BACKLOG = 128
END_WITHIN_S = 1.0

for _name in ("uvicorn", "uvicorn.error", "uvicorn.access"):
    # Any client could fill the log; the page logs its own.
    logging.getLogger(_name).setLevel(logging.CRITICAL)

_LIMITS_S = {
    "first request": REQUEST_WITHIN_S,
    "body": REQUEST_WITHIN_S,
    "request": IDLE_S,
    "reader": WRITE_WITHIN_S,
}


class Connection(H11Protocol):
    """One connection, whose deadlines `Server` watches."""

    on_end: Callable[[Connection], None]
    since_s: float  # of the present wait: for a request, for its body, for the client to read
    waits_for = ""

    def data_received(self, data: bytes) -> None:
        """Take bytes; those that HTTP does not allow end the connection, whatever state it is in."""
        try:
            super().data_received(data)
        except (h11.ProtocolError, UnicodeError, ValueError):
            self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        super().connection_lost(exc)
        self.on_end(self)

    def present_wait(self) -> str:
        """Return what the connection waits for: a request, the client to read, or nothing."""
        if self.flow is not None and self.flow.write_paused:
            return "reader"
        if self.cycle is None:
            return "first request"
        if self.cycle.response_complete:
            return "request"
        return "body" if self.cycle.more_body else ""


class Server:
    """Serves an ASGI application at one address; on the application's loop."""

    def __init__(self, app: Any, settings: WebSettings) -> None:
        self._config = Config(
            app,
            http="h11",
            ws="none",
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            timeout_keep_alive=int(IDLE_S),
            h11_max_incomplete_event_size=MAX_HEADER_BYTES,
        )
        self._settings = settings
        self._state = ServerState()
        self._connections: set[Connection] = set()
        self._opening: set[asyncio.Task[None]] = set()
        self._context: ssl.SSLContext | None = None
        self.is_open = asyncio.Event()

    async def run(self) -> None:
        """Serve until cancelled; OSError when the address or the certificate cannot be used."""
        await self.renew()
        self._config.load()
        listener = _listening(self._settings.host, self._settings.port)
        self.is_open.set()
        watching = asyncio.create_task(self._watch(), name="web connections")
        try:
            await self._accept(listener)
        finally:
            watching.cancel()
            listener.close()
            await self._end()

    async def renew(self) -> None:
        """Use the certificate's files as they are now, for connections to come; OSError: the ones before."""
        self._context = await asyncio.to_thread(_context_of, self._settings)

    async def _accept(self, listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, _ = await loop.sock_accept(listener)
            except OSError as error:  # aborted by the client, or out of descriptors
                log.warning("the page cannot accept a connection: %s", error)
                await asyncio.sleep(LOOK_S)
                continue
            if len(self._connections) + len(self._opening) >= MOST_CONNECTIONS and not self._make_room():
                accepted.close()
                continue
            task = loop.create_task(self._open(accepted, self._context))
            self._opening.add(task)
            task.add_done_callback(self._opening.discard)

    async def _open(self, accepted: socket.socket, context: ssl.SSLContext | None) -> None:
        """Make a connection of what was accepted; one whose handshake fails is dropped without a word."""
        loop = asyncio.get_running_loop()
        limit_s = None if context is None else HANDSHAKE_WITHIN_S
        with contextlib.suppress(OSError, ssl.SSLError, TimeoutError):
            accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            await loop.connect_accepted_socket(
                self._new_connection,
                accepted,
                ssl=context,
                ssl_handshake_timeout=limit_s,
                ssl_shutdown_timeout=None if context is None else WRITE_WITHIN_S,
            )
            return
        accepted.close()

    def _new_connection(self) -> Connection:
        loop = asyncio.get_running_loop()
        connection = Connection(self._config, self._state, {}, loop)
        connection.on_end = self._connections.discard
        connection.since_s = loop.time()
        self._connections.add(connection)
        return connection

    def _make_room(self) -> bool:
        """Abort the connection that has waited longest without a request; return whether there was one."""
        idle = [each for each in self._connections if each.present_wait() in ("first request", "request")]
        if not idle:
            return False
        oldest = min(idle, key=lambda each: each.since_s)
        self._abort(oldest)
        return True

    async def _watch(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(LOOK_S)
            now_s = loop.time()
            for connection in tuple(self._connections):
                waits_for = connection.present_wait()
                if waits_for != connection.waits_for:
                    connection.waits_for, connection.since_s = waits_for, now_s
                elif waits_for and now_s - connection.since_s > _LIMITS_S[waits_for]:
                    self._abort(connection)

    def _abort(self, connection: Connection) -> None:
        self._connections.discard(connection)
        if connection.transport is not None:
            with contextlib.suppress(AttributeError):  # early Python 3.11, closed twice by uvicorn
                connection.transport.abort()

    async def _end(self) -> None:
        """End every connection: at once, but for what its client still takes within a moment."""
        for task in tuple(self._opening):
            task.cancel()
        for connection in tuple(self._connections):
            # A TLS transport that is closed twice cannot be aborted: it waits for its client.
            if connection.transport is not None and not connection.transport.is_closing():
                connection.shutdown()
        under_way = {*self._state.tasks, *self._opening}
        # Not asyncio.timeout: up to Python 3.11.3 it does not end by itself in a task being cancelled.
        if under_way:
            await asyncio.wait(under_way, timeout=END_WITHIN_S)
        for request in tuple(self._state.tasks):
            request.cancel()
        for connection in tuple(self._connections):
            self._abort(connection)


def _context_of(settings: WebSettings) -> ssl.SSLContext | None:
    if settings.cert_file is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    load_key_pair(context, settings.cert_file, settings.key_file)
    return context


def _listening(host: str, port: int) -> socket.socket:
    is_6 = ":" in host
    family = socket.AF_INET6 if is_6 else socket.AF_INET
    both = is_6 and socket.has_dualstack_ipv6()
    listener = socket.create_server((host, port), family=family, backlog=BACKLOG, dualstack_ipv6=both)
    listener.setblocking(False)  # noqa: FBT003 - the socket's way
    return listener

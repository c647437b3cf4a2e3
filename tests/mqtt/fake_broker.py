"""A broker that misbehaves on order: it speaks just enough MQTT for one client."""

from __future__ import annotations

import asyncio
import ssl
from dataclasses import dataclass, field
from types import TracebackType

from tests.mosquitto import Certificate

CONNECT, PUBLISH, SUBSCRIBE, PINGREQ, DISCONNECT = 1, 3, 8, 12, 14
LEVEL_5, LEVEL_311 = 5, 4

ACCEPT_5 = bytes.fromhex("20 03 00 00 00")
ACCEPT_311 = bytes.fromhex("20 02 00 00")
REFUSE_VERSION = bytes.fromhex("20 02 00 01")  # as a broker that knows only MQTT 3.1.1 answers
HANG_UP = b""


@dataclass
class Packet:
    """What the client sent."""

    kind: int
    body: bytes
    qos: int = 0  # of a PUBLISH

    @property
    def packet_id(self) -> bytes:
        """Return the packet id of a QoS 1 publication or a subscription."""
        start = 2 + int.from_bytes(self.body[:2], "big") if self.kind == PUBLISH else 0
        return self.body[start : start + 2]


@dataclass
class FakeBroker:
    """`answers` maps protocol levels to what follows a CONNECT; None is silence, HANG_UP closes."""

    answers: dict[int, bytes | None] = field(
        default_factory=lambda: {LEVEL_5: ACCEPT_5, LEVEL_311: ACCEPT_311}
    )
    suback_code: int = 1
    puback_code: int = 0
    tls: Certificate | None = None
    answers_subscriptions: bool = True
    before_suback: bytes = b""
    after_suback: bytes = b""
    port: int = 0
    levels: list[int] = field(default_factory=list)  # of the CONNECTs seen
    attempts: int = 0  # connections, also those whose handshake failed

    async def __aenter__(self) -> FakeBroker:
        self._context = None if self.tls is None else ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        if self._context is not None and self.tls is not None:
            self._context.sni_callback = self._note_attempt
            self.use(self.tls)
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0, ssl=self._context)
        self._writers: list[asyncio.StreamWriter] = []
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.close()
        for writer in self._writers:
            writer.close()
        await asyncio.gather(*(writer.wait_closed() for writer in self._writers), return_exceptions=True)

    def use(self, certificate: Certificate) -> None:
        """Show this certificate from now on."""
        assert self._context is not None
        self._context.load_cert_chain(certificate.cert, certificate.key)

    def send(self, packet: bytes) -> None:
        """Send to the newest connection."""
        self._writers[-1].write(packet)

    def hang_up(self) -> None:
        """Close the newest connection."""
        self._writers[-1].close()

    def _note_attempt(self, *_: object) -> None:
        self.attempts += 1

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        try:
            while await self._answer(await _read(reader), writer):
                pass
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        writer.close()

    async def _answer(self, packet: Packet, writer: asyncio.StreamWriter) -> bool:
        """Answer one packet; return whether to stay connected."""
        if packet.kind == CONNECT:
            level = packet.body[6]
            self.levels.append(level)
            answer = self.answers[level]
            writer.write(answer or b"")
            return answer != HANG_UP
        if packet.kind == SUBSCRIBE:
            properties = b"\x00" if self.levels[-1] == LEVEL_5 else b""
            body = packet.packet_id + properties + bytes([self.suback_code])
            suback = bytes([0x90, len(body)]) + body if self.answers_subscriptions else b""
            writer.write(self.before_suback + suback + self.after_suback)
            return True
        if packet.kind == PINGREQ:
            writer.write(b"\xd0\x00")
        if packet.kind == PUBLISH and packet.qos:
            reason = bytes([self.puback_code]) if self.puback_code else b""
            writer.write(bytes([0x40, 2 + len(reason)]) + packet.packet_id + reason)
        return packet.kind != DISCONNECT


async def _read(reader: asyncio.StreamReader) -> Packet:
    first = (await reader.readexactly(1))[0]
    size = shift = 0
    while True:
        byte = (await reader.readexactly(1))[0]
        size |= (byte & 0x7F) << shift
        shift += 7
        if not byte & 0x80:
            return Packet(first >> 4, await reader.readexactly(size), first >> 1 & 3)

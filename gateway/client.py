"""Commands from another Python program: `Client` handles ids, freshness, phases and time-outs.

client = Client("mqtt://127.0.0.1", base="starters/mcc1", client="alice")
result = await client.command("pump-1", "start")
if not result.is_confirmed:
    print(result.phase, result.text, result.what_to_do)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from secrets import token_hex
from typing import Any

from gateway.config import split_url
from gateway.contract import DEFAULT_TTL_S, CommandRequest, ResultRecord, Topics, is_level
from gateway.errors import UsageError
from gateway.mqtt import BrokerSettings, CommandClient, TlsSettings

WITHIN_S = 30.0


class Client:
    """One operator's way to one gateway.

    Each command has a connection of its own, so that nothing is ever queued for later: what cannot be sent
    now is not sent, and BrokerError says why. Any number of commands may be under way at the same time.
    """

    def __init__(
        self,
        url: str | BrokerSettings,
        *,
        base: str,
        client: str,
        username: str | None = None,
        password: str | None = None,
        ca_file: str | None = None,
        operator: str | None = None,
    ) -> None:
        """`client` is the level in the command topic, `operator` a claim for the audit; or UsageError.

        The broker's settings may take the place of its URL, login and authority.
        """
        if isinstance(url, str):
            url = broker_at(url, username=username, password=password, ca_file=ca_file)
        self._broker = url
        if not all(is_level(level) for level in (*base.split("/"), client)):
            raise UsageError(f"{base!r} or {client!r} has other characters than a-z, 0-9, _ and -")
        self._topics = Topics(base)
        self._client = client
        self._operator = operator

    async def command(
        self,
        starter: str,
        verb: str,
        args: Mapping[str, Any] | None = None,
        *,
        id_: str | None = None,
        reason: str | None = None,
        expect: Mapping[str, Any] | None = None,
        select: str | None = None,
        ttl_s: float | None = None,
        within_s: float = WITHIN_S,
        on_phase: Callable[[ResultRecord], None] | None = None,
    ) -> ResultRecord:
        """Return the final result. BrokerError: not sent. NoResultError: sent, but its end is unknown.

        To ask for the outcome of a command, send it again with its `id_`: it is never carried out twice.
        """
        order = CommandRequest(
            starter=starter,
            client=self._client,
            verb=verb,
            args=args or {},
            operator=self._operator,
            reason=reason,
            id=id_,
            ttl_s=DEFAULT_TTL_S if ttl_s is None else ttl_s,
            expect=expect or {},
            select=select,
        )
        return await self.connection().send(
            order, now_s=time.time(), within_s=within_s, on_phase=on_phase or (lambda _: None)
        )

    async def start(self, starter: str, *, reason: str | None = None) -> ResultRecord:
        """Start a motor."""
        return await self.command(starter, "start", reason=reason)

    async def stop(self, starter: str, *, reason: str | None = None) -> ResultRecord:
        """Stop a motor, or all motors of a group; it is sent even when no gateway seems to be there."""
        return await self.command(starter, "stop", reason=reason)

    async def read(self, starter: str, parameter: str) -> ResultRecord:
        """Read a parameter, by its manual's code."""
        return await self.command(starter, "read", {"parameter": parameter})

    async def set(
        self, starter: str, parameter: str, value: float | str, *, reason: str | None = None
    ) -> ResultRecord:
        """Set a parameter to a number, or to an enum's label."""
        return await self.command(starter, "set", {"parameter": parameter, "value": value}, reason=reason)

    def connection(self) -> CommandClient:
        """Return a way of its own, for one command or one question."""
        return CommandClient(replace(self._broker, client_id=f"{self._client}-{token_hex(6)}"), self._topics)


def broker_at(
    url: str,
    *,
    client_id: str = "",
    username: str | None = None,
    password: str | None = None,
    ca_file: str | None = None,
) -> BrokerSettings:
    """Return the way to the broker of a URL; UsageError when it is none."""
    parts = split_url(url)
    if parts is None:
        raise UsageError(f"{url!r} is no broker (mqtt://host[:port] or mqtts://host[:port])")
    tls = TlsSettings(ca_file) if parts[0].scheme == "mqtts" else None
    return BrokerSettings(parts[0].hostname or "", parts[1], client_id, username, password, tls=tls)

"""One starter as the running gateway gives it: its facts, its rows and its settings, by commands over MQTT.

The gateway judges each command as any operator's: rights, locks, identity, watchdogs, writes an hour.
"""

from __future__ import annotations

import asyncio
import time
from argparse import Namespace
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from gateway.cli.broker import client_of, settings_of, user_name
from gateway.cli.command import Progress, place_of
from gateway.config import load
from gateway.contract import CommandRequest, InfoRecord, Phase, Proof, ResultCode, ResultRecord, Topics
from gateway.errors import BrokerError
from gateway.families import Profile, Variant
from gateway.mqtt import BrokerSettings, CommandClient

INFO_WITHIN_S = 5.0  # the retained facts come with the subscription
RESULT_WITHIN_S = 90.0
READ_TTL_S = 60.0  # a busy line takes its time for so many rows
ROWS_AT_ONCE = 64  # of one `read`
PACE_S = 0.25  # between two commands: the gateway takes five a second from one client for one starter


@dataclass(slots=True)
class RowsRead:
    """What was read: values by code, as a result has them; `refused` says why others were not."""

    values: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    @property
    def rows(self) -> dict[str, tuple[int, ...]]:
        """Return the raw words by code."""
        return {code: tuple(value["raw"]) for code, value in self.values.items()}


@dataclass(frozen=True, slots=True)
class LiveStarter:
    """A starter of a configuration, reached as an operator's program reaches it."""

    name: str
    profile: Profile
    client: str
    settings: BrokerSettings
    topics: Topics

    @classmethod
    def find(cls, config_path: str, name: str, login: Namespace) -> Self:
        """Return a starter of a configuration; `login` has the options of `add_login`. UsageError."""
        config = load(config_path)
        _, table = place_of(config, name)
        client = client_of(config, login.client)
        settings = settings_of(config, Path(config_path).parent, tool="parameters", login=login)
        return cls(name, table.profile(), client, settings, Topics(config.base))

    async def info(self) -> InfoRecord:
        """Return what the gateway says that the starter is; BrokerError when it says nothing."""
        sender = CommandClient(self.settings, self.topics)
        info = await sender.retained(InfoRecord, within_s=INFO_WITHIN_S, starter=self.name)
        if info is None:
            raise BrokerError(f"no gateway has published the facts of {self.name}", "is the gateway running?")
        return info

    async def command(
        self,
        verb: str,
        args: Mapping[str, Any],
        *,
        proof: Proof | None = None,
        expect: Mapping[str, Any] | None = None,
    ) -> ResultRecord:
        """Return a command's final result; BrokerError when it was not sent, NoResultError without one."""
        order = CommandRequest(
            starter=self.name,
            client=self.client,
            verb=verb,
            args=args,
            operator=user_name(),
            proof=proof or Proof(),
            expect=expect or {},
        )
        await asyncio.sleep(PACE_S)
        sender = CommandClient(self.settings, self.topics)
        return await sender.send(order, now_s=time.time(), within_s=RESULT_WITHIN_S, on_phase=lambda _: None)

    async def read(self, codes: Collection[str], progress: Progress | None = None) -> RowsRead:
        """Read rows, and show how far this has come, if wanted. BrokerError, NoResultError.

        One row that the starter refuses has the whole command refused: halves find it.
        """
        found = RowsRead()
        all_codes = tuple(codes)
        waiting = deque(all_codes[at : at + ROWS_AT_ONCE] for at in range(0, len(all_codes), ROWS_AT_ONCE))
        while waiting:
            batch = waiting.popleft()
            result = await self.command("read", {"parameters": batch}, proof=Proof(ttl_s=READ_TTL_S))
            is_divided = result.phase is Phase.FAILED or result.code == ResultCode.EXPIRED
            if result.phase is Phase.CONFIRMED:
                found.values |= result.values["values"]
                _refuse_another(self.name, found)
            elif is_divided and len(batch) > 1:
                middle = len(batch) // 2
                waiting.extendleft((batch[middle:], batch[:middle]))
                continue
            elif result.phase is Phase.FAILED:
                found.refused[batch[0]] = result.text
            else:
                raise BrokerError(f"the gateway reads nothing of {self.name}: {result.text} [{result.code}]")
            if progress is not None:
                progress.show((len(found.values) + len(found.refused)) / len(all_codes), batch[-1])
        if progress is not None:
            progress.clear()
        return found


def variant_of(info: InfoRecord) -> Variant:
    """Return what distinguishes a starter from others of its family."""
    return Variant(model=info.model, firmware=info.firmware, slot=info.slot)


def _refuse_another(starter: str, found: RowsRead) -> None:
    """BrokerError for a device that contradicts the configuration: the gateway gives its raw words alone."""
    for value in found.values.values():
        if value.get("reason"):
            raise BrokerError(f"{starter} is not the configured starter: {value['reason']}")

"""One starter as the running gateway gives it: its facts, its rows and its settings, by commands over MQTT.

The gateway judges each command as any operator's: rights, locks, identity, watchdogs, writes an hour.
"""

from __future__ import annotations

import asyncio
from argparse import Namespace
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from gateway.cli.broker import operator_at
from gateway.cli.command import Progress, place_of
from gateway.client import Client
from gateway.config import load
from gateway.contract import InfoRecord, Phase, ResultCode, ResultRecord
from gateway.errors import BrokerError
from gateway.families import Profile, Variant

INFO_WITHIN_S = 5.0  # the retained facts come with the subscription
RESULT_WITHIN_S = 90.0
ROWS_AT_ONCE = 64  # of one `read`
READ_TTL_S = 60.0  # a busy line takes its time for so many rows
PACE_S = 0.25  # between two commands: the gateway takes five a second from one client for one starter


@dataclass(slots=True)
class RowsRead:
    """The raw words that were read, by code; `refused` says why others were not."""

    rows: dict[str, tuple[int, ...]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class LiveStarter:
    """A starter of a configuration, reached as an operator's program reaches it."""

    name: str
    profile: Profile
    operator: Client

    @classmethod
    def find(cls, config_path: str, name: str, login: Namespace) -> Self:
        """Return a starter of a configuration; `login` has the options of `add_login`. UsageError."""
        config = load(config_path)
        _, table = place_of(config, name)
        operator = operator_at(config, Path(config_path).parent, login)
        return cls(name, table.profile(), operator)

    async def info(self) -> InfoRecord:
        """Return what the gateway says that the starter is; BrokerError when it says nothing."""
        asking = self.operator.connection()
        info = await asking.retained(InfoRecord, within_s=INFO_WITHIN_S, starter=self.name)
        if info is None:
            raise BrokerError(f"no gateway has published the facts of {self.name}", "is the gateway running?")
        return info

    async def command(self, verb: str, args: Mapping[str, Any], **demands: Any) -> ResultRecord:
        """Return a command's final result; see `Client.command`."""
        await asyncio.sleep(PACE_S)
        return await self.operator.command(self.name, verb, args, within_s=RESULT_WITHIN_S, **demands)

    async def read(self, codes: Collection[str], progress: Progress | None = None) -> RowsRead:
        """Read rows, and show how far this has come, if wanted. BrokerError, NoResultError.

        One row that the starter refuses has the whole command refused: halves find it.
        """
        found, all_codes = RowsRead(), tuple(codes)
        waiting = deque(all_codes[at : at + ROWS_AT_ONCE] for at in range(0, len(all_codes), ROWS_AT_ONCE))
        while waiting:
            batch = waiting.popleft()
            result = await self.command("read", {"parameters": batch}, ttl_s=READ_TTL_S)
            is_divided = result.phase is Phase.FAILED or result.code == ResultCode.EXPIRED
            if result.phase is Phase.CONFIRMED:
                found.rows |= self._words(result)
            elif is_divided and len(batch) > 1:
                middle = len(batch) // 2
                waiting.extendleft((batch[middle:], batch[:middle]))
                continue
            elif result.phase is Phase.FAILED:
                found.refused[batch[0]] = result.text
            else:
                raise BrokerError(f"the gateway reads nothing of {self.name}: {result.text} [{result.code}]")
            if progress is not None:
                progress.show((len(found.rows) + len(found.refused)) / len(all_codes), batch[-1])
        if progress is not None:
            progress.clear()
        return found

    def _words(self, result: ResultRecord) -> dict[str, tuple[int, ...]]:
        """Return what a `read` gave, by code; BrokerError for another device than the one configured.

        Of a device that contradicts the configuration the gateway gives the raw words alone, and why.
        """
        values = result.values["values"]
        for value in values.values():
            if value.get("reason"):
                raise BrokerError(f"{self.name} is not the configured starter: {value['reason']}")
        return {code: tuple(value["raw"]) for code, value in values.items()}


def variant_of(info: InfoRecord) -> Variant:
    """Return what distinguishes a starter from others of its family."""
    return Variant(model=info.model, firmware=info.firmware, slot=info.slot)

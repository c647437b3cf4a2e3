"""Whether the broker can be reached with the gateway's login, and a running gateway asked through it."""

from __future__ import annotations

import os
import time
import uuid
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gateway.commands.doctor_remark import Remark
from gateway.config.schema import Config
from gateway.config.secrets import mqtt_password
from gateway.config.setups import rights_of, tls_files_of
from gateway.errors import BrokerError, ConfigError
from gateway.families.finding import Weight
from gateway.mqtt.sender import Order, Sender, connected
from gateway.mqtt.settings import BrokerSettings, TlsSettings
from gateway.mqtt.topics import Topics
from gateway.starters.records import Phase

READ_WITHIN_S = 10.0

_VERB = "read"


class BrokerAccess:
    """The broker of a configuration, as this doctor may use it."""

    def __init__(self, config: Config, folder: Path) -> None:
        self._config = config
        self._folder = folder
        self._settings: BrokerSettings | None = None  # once a login has succeeded

    async def remarks(self) -> list[Remark]:
        """Log in as the gateway does, under another client id, and tell what came of it."""
        try:
            settings = self._made_settings()
        except ConfigError as error:
            return [Remark("mqtt.password_file", str(error), Weight.ERROR)]
        remarks = []
        if self._config.mqtt.password_file is not None:
            remarks.append(Remark("mqtt.password_file", "only its owner may read it"))
        where = f"broker {settings.address}"
        try:
            version = await _log_in(settings)
        except BrokerError as error:
            return [*remarks, Remark(where, str(error), Weight.ERROR)]
        self._settings = settings
        return [*remarks, Remark(where, f"takes the gateway's login, MQTT {version}")]

    def client_for(self, starter: str) -> str | None:
        """Return an operator who may read this starter, None when there is none."""
        rights = rights_of(self._config)
        clients = (operator.client for operator in self._config.operators)
        return next((each for each in clients if rights.is_allowed(each, verb=_VERB, starter=starter)), None)

    async def read(self, starter: str, codes: Iterable[str]) -> dict[str, tuple[int, ...]]:
        """Return the raw words of these rows, asked of the running gateway; what it refuses is left out.

        BrokerError when the broker, the gateway or the right to ask is missing.
        """
        client = self.client_for(starter)
        if self._settings is None:
            raise BrokerError("the broker cannot be used", "see above")
        if client is None:
            raise BrokerError("no operator may read it", f'add an [[operator]] who may "{_VERB}"')
        rows: dict[str, tuple[int, ...]] = {}
        for code in codes:
            order = Order(starter, client, _VERB, {"parameter": code}, operator="doctor")
            sender = Sender(self._settings, Topics(self._config.base))
            result = await sender.send(
                order, now_s=time.time(), within_s=READ_WITHIN_S, on_phase=lambda _: None
            )
            if result is None:
                raise BrokerError("the gateway gives no result", "is it allowed to read commands?")
            if result.get("phase") == Phase.CONFIRMED:
                rows[code] = _words(result)
        return rows

    def _made_settings(self) -> BrokerSettings:
        mqtt = self._config.mqtt
        return BrokerSettings(
            host=mqtt.host,
            port=mqtt.port,
            client_id=f"{self._config.gateway.name}-doctor-{uuid.uuid4().hex[:8]}",  # never the gateway's own
            username=mqtt.username,
            password=mqtt_password(self._config, self._folder, os.environ),
            tls=TlsSettings(*tls_files_of(self._config, self._folder)) if mqtt.is_tls else None,
            keepalive_s=mqtt.keepalive_s,
        )


async def _log_in(settings: BrokerSettings) -> str:
    """Connect once and leave; return the version that the broker takes."""
    session, version = await connected(settings, on_incoming=lambda _: None, on_ack=lambda _, __: None)
    await session.disconnect()
    return version.value


def _words(result: Mapping[str, Any]) -> tuple[int, ...]:
    raw = result.get("raw")
    return tuple(int(word) for word in raw) if isinstance(raw, list) else ()

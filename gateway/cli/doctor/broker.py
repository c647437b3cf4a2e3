"""Checks the broker with the gateway's login, and reads settings through a running gateway."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from gateway.cli.doctor.machine import DoctorFinding
from gateway.cli.operator_login import settings_of, user_name
from gateway.config.convert import rights_of
from gateway.config.schema import Config
from gateway.contract import AvailabilityRecord, Phase, Topics, rfc3339
from gateway.errors import BrokerError, ConfigError
from gateway.families import Weight
from gateway.mqtt import BrokerSettings, CommandClient, Order, connected

OWN_NAME = "doctor"
READ_WITHIN_S = 10.0
KNOWN_WITHIN_S = 2.0

_VERB = "read"


@dataclass
class BrokerAccess:
    """The broker of a configuration, as this doctor may use it.

    The gateway's own login is tried, or `username` in its place; a running gateway is asked as `client`.
    """

    config: Config
    folder: Path
    client: str = OWN_NAME
    username: str | None = None
    password_file: str | None = None
    _settings: BrokerSettings | None = field(default=None, init=False)  # once a login has succeeded

    async def remarks(self) -> list[DoctorFinding]:
        """Log in, under another client id than the gateway, and return what was found."""
        try:
            settings = settings_of(self.config, self.folder, tool=OWN_NAME)
        except ConfigError as error:
            return [DoctorFinding("mqtt.password_file", str(error), Weight.ERROR)]
        remarks = []
        if self.config.mqtt.password_file is not None:
            remarks.append(DoctorFinding("mqtt.password_file", "only its owner may read it"))
        who = "the gateway's login"
        where = f"broker {settings.address}"
        try:
            if self.username is not None:  # the gateway could be disconnected by a second one with its login
                who = f"the login {self.username}"
                login = Namespace(username=self.username, password_file=self.password_file)
                settings = settings_of(self.config, self.folder, tool=OWN_NAME, login=login)
            session, version = await connected(settings)
            await session.disconnect()
        except (BrokerError, ConfigError) as error:
            return [*remarks, DoctorFinding(where, f"{who}: {error}", Weight.ERROR)]
        self._settings = settings
        return [*remarks, DoctorFinding(where, f"takes {who}, MQTT {version.value}")]

    async def known(self, starter: str) -> str:
        """Return the running gateway's reason why a starter cannot be read; empty when it can.

        BrokerError when the broker, or the right to read it, is missing.
        """
        topics = Topics(self.config.base)
        asking = CommandClient(self._usable(), topics)
        known = await asking.retained(AvailabilityRecord, within_s=KNOWN_WITHIN_S, starter=starter)
        if known is None or known.state == "online":
            return ""
        since = f" since {at}" if (at := rfc3339(known.since_s)) else ""
        return f"the gateway says: {known.state}{since}: {known.reason or 'no reason given'}"

    async def read(self, starter: str, codes: Iterable[str]) -> dict[str, tuple[int, ...]]:
        """Return the raw words of these rows, asked of the running gateway; what it refuses is left out.

        BrokerError when the broker, the gateway or the right to ask is missing, or everything is refused.
        """
        settings = self._usable()
        if not rights_of(self.config).is_allowed(self.client, verb=_VERB, starter=starter):
            raise BrokerError(
                f"no [[operator]] {self.client} may read it",
                f'add one with client = "{self.client}", may = ["{_VERB}"], or name yours with --client',
            )
        rows: dict[str, tuple[int, ...]] = {}
        refusal = ""
        for code in codes:
            order = Order(starter, self.client, _VERB, {"parameter": code}, operator=user_name())
            sender = CommandClient(settings, Topics(self.config.base))  # for one command
            sending = sender.send(order, now_s=time.time(), within_s=READ_WITHIN_S, on_phase=lambda _: None)
            result = await sending
            if result is None:
                raise BrokerError("the gateway gives no result", "is it allowed to read commands?")
            if result.phase is Phase.CONFIRMED:
                rows[code] = tuple(result.values.get("raw") or ())
            else:
                refusal = f"the gateway refuses to read it: {result.text} [{result.code}]"
        if refusal and not rows:
            raise BrokerError(refusal)
        return rows

    def _usable(self) -> BrokerSettings:
        if self._settings is None:
            raise BrokerError("the broker cannot be used", "see above")
        return self._settings

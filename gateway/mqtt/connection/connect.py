"""How a client connects: in which version of MQTT, and how soon again after a failure.

MQTT 5 first, and 3.1.1 only to a broker that refuses 5. A refusal is a CONNACK that says so, or a connection
that the broker closed right upon the CONNECT, CLOSED times in a row, as brokers do that cannot even read a
CONNECT of MQTT 5. Closed once, it may have been ended or restarted just then. Silence is never a refusal: a
broker that stood still, or a stalled network, knows MQTT 5 as before, and 3.1.1 would hide the retained flag
of what it delivers.
"""

from __future__ import annotations

import logging

from gateway.errors import BrokerError
from gateway.mqtt.connection.reasons import UNSUPPORTED_VERSION
from gateway.mqtt.connection.session import Session, SessionParts
from gateway.mqtt.connection.settings import BrokerSettings, Version

log = logging.getLogger(__name__)

FIRST_RETRY_S = 0.5
LAST_RETRY_S = 4.0  # one client: what SCADA misses weighs more than what a broker has to refuse
STEADY_S = 5.0  # a connection that held this long makes the next pause short again
CLOSED = 2  # so often it is a refusal


async def connected(settings: BrokerSettings, parts: SessionParts | None = None) -> Session:
    """Return a new connection, in the version that the broker takes; BrokerError when it cannot be had."""
    version, closed = settings.version or Version.V5, 0
    while True:
        session = Session(settings, version, parts or SessionParts())
        try:
            await session.connect()
        except BrokerError as error:
            closed += session.is_closed_unanswered
            is_refused = session.connack_code == UNSUPPORTED_VERSION or closed == CLOSED
            may_go_on = is_refused or session.is_closed_unanswered
            session.abort()
            if settings.version is not None or version is Version.V311 or not may_go_on:
                raise
            version = Version.V311 if is_refused else Version.V5
            log.debug("broker=%s %s; next: MQTT %s", settings.address, error, version)
        else:
            return session

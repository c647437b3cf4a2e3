"""A bridge to a central broker, as the configuration of a Mosquitto of its own beside the edge's broker.

It is a process of its own for two reasons. A Mosquitto does not apply its access list to its own bridges:
here the bridge logs in at the edge like any client, and may write only commands of remote operators. And
Mosquitto 2.0.11 hangs after a TLS handshake that the other side breaks off: here the edge's broker goes on.

Telemetry waits while the link is cut. It goes by MQTT 3.1.1: with MQTT 5 Mosquitto's bridges ask for no
session expiry, so that brokers store nothing for them. Commands never wait anywhere: clean sessions, and
MQTT 5, whose message expiry passes the bridge. Every topic is named, so that nothing comes back by another
connection. Of operators only those with `freshness = "issued_at"` pass, each by a line of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

from gateway.cli.broker_kit.logins import NOTICE
from gateway.cli.broker_kit.rights import Login, Role
from gateway.cli.broker_kit.settings import KitSettings
from gateway.config import Config, is_loopback
from gateway.errors import UsageError

LOOPBACK_PORT = 18883  # of the edge's broker, for the bridge: TLS would gain nothing there
BRIDGE_PORT = 18884  # of the bridge itself; no login may use it
_HEAD = f"""\
# The bridge of this site to the central broker, a Mosquitto of its own; written by
# `starter-gateway broker-kit`. It holds passwords. Do not add `topic # out`, nor a topic in both directions:
# what came in would go out again.

listener {BRIDGE_PORT} 127.0.0.1
allow_anonymous false
persistence true
persistence_location /var/lib/mosquitto-bridge/
autosave_interval 5
max_queued_messages 100000
"""
_CLEAN = """\
bridge_protocol_version mqttv50
# a command never waits
cleansession true
bridge_outgoing_retain false
keepalive_interval 15"""
_WAITING = """\
bridge_protocol_version mqttv311
# what cannot be sent now waits; 2.0.11 queues everything retained with each attempt to connect: few of them
cleansession false
keepalive_interval 15"""


def edge_port(config: Config) -> int:
    """Return the port of the edge's broker on 127.0.0.1: its own, or with TLS one for the bridge alone."""
    host = config.mqtt.host
    is_elsewhere = is_loopback(host) and host not in ("localhost", "127.0.0.1")
    return LOOPBACK_PORT if config.mqtt.is_tls or is_elsewhere else config.mqtt.port


def bridge_conf(
    config: Config, settings: KitSettings, logins: Sequence[Login], there: Sequence[Login], *, ca_path: str
) -> str:
    """Return the configuration of the bridge's Mosquitto; it holds its passwords at both brokers.

    `there` are the central broker's logins, `ca_path` is its authority on the edge's machine, empty for the
    system's authorities. UsageError for a broker at one of the bridge's ports, and for a topic that a
    bridge's line cannot name.
    """
    edge, central = ({role: login for login in side for role in login.roles} for side in (logins, there))
    out, into = edge[Role.BRIDGE_UP].reads, edge[Role.BRIDGE_DOWN].writes if Role.BRIDGE_DOWN in edge else []
    if config.mqtt.port in (LOOPBACK_PORT, BRIDGE_PORT):
        raise UsageError(f"port {config.mqtt.port} is the bridge's own (give mqtt.url another)")
    if spaced := [topic for topic in (*out, *into) if " " in topic]:
        raise UsageError(f"a bridge cannot pass {spaced[0]!r} (choose names without spaces)")
    here, base = f"127.0.0.1:{edge_port(config)}", settings.central_base(config)
    away = f"{settings.central_address()}\n"
    away += f"bridge_cafile {ca_path}" if ca_path else "bridge_capath /etc/ssl/certs"
    parts = [_HEAD]
    for name, side, role, place, filters, direction, other in (
        ("edge-telemetry", edge, Role.BRIDGE_UP, here, out, "in", config.base),
        ("telemetry", central, Role.BRIDGE_UP, away, out, "out", base),
        ("commands", central, Role.BRIDGE_DOWN, away, into, "in", base),
        ("edge-commands", edge, Role.BRIDGE_DOWN, here, into, "out", config.base),
    ):
        if not filters:
            continue
        login, is_notified = side[role], name == "telemetry"
        parts += [
            f"connection {config.gateway.name}-{name}",
            f"address {place}",
            f"remote_clientid {login.name}\nremote_username {login.name}\nremote_password {login.password}",
            _CLEAN if name.endswith("commands") else _WAITING,
            "restart_timeout 5 120" if is_notified else "restart_timeout 2 30",
            f"notification_topic {base}/{NOTICE}" if is_notified else "notifications false",
        ]
        for topic in filters:  # below the gateway's base the other side has another one
            pattern = topic.removeprefix(f"{config.base}/")
            moved = f" {config.base}/ {other}/" if pattern != topic else ""
            parts.append(f"topic {pattern} {direction} 1{moved}")
        parts.append("")
    return "\n".join(parts)

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

from collections.abc import Mapping, Sequence

from gateway.cli.broker_kit.logins import BRIDGE_DOWN, BRIDGE_UP, by_name, gateway_login
from gateway.cli.broker_kit.rights import Login, Role, remote_clients
from gateway.config import Config, is_loopback
from gateway.errors import UsageError

LOOPBACK_PORT = 18883  # of the edge's broker, for the bridge: TLS would gain nothing there
BRIDGE_PORT = 18884  # of the bridge itself; no login may use it
NOTICE = "bridge"  # below the central base: 1 while the telemetry's connection stands, else 0; retained
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


def bridge_logins(config: Config) -> tuple[str, str]:
    """Return the two logins of the bridge at the central broker: for telemetry, and for commands."""
    name = gateway_login(config)
    return f"{name}-up", f"{name}-down"


def edge_port(config: Config) -> int:
    """Return the port of the edge's broker on 127.0.0.1: its own, or with TLS one for the bridge alone."""
    host = config.mqtt.host
    is_elsewhere = is_loopback(host) and host not in ("localhost", "127.0.0.1")
    return LOOPBACK_PORT if config.mqtt.is_tls or is_elsewhere else config.mqtt.port


def central_logins(config: Config, logins: Sequence[Login], base: str) -> tuple[Login, ...]:
    """Return who logs in at the central broker for this site, with rights below this site's base only.

    UsageError for a broker at one of the bridge's ports, and for an operator with the name of one of its
    logins, who would have its rights.
    """
    if config.mqtt.port in (LOOPBACK_PORT, BRIDGE_PORT):
        raise UsageError(f"port {config.mqtt.port} is the bridge's own (give mqtt.url another)")
    (up, down), (out, into), notice = bridge_logins(config), _passing(logins), f"{base}/{NOTICE}"
    found = [Login(up, "", {Role.BRIDGE_UP}, [], [*_moved(config, out, base), notice])]
    if into:
        found.append(Login(down, "", {Role.BRIDGE_DOWN}, _moved(config, into, base)))
    for login in logins:
        if login.name in remote_clients(config):
            reads, writes = (
                _moved(config, [each for each in filters if each.startswith(f"{config.base}/")], base)
                for filters in (login.reads, login.writes)
            )
            found.append(Login(login.name, login.name, {Role.OPERATOR}, [*reads, notice], writes))
    return tuple(by_name(found).values())


def bridge_conf(
    config: Config,
    logins: Sequence[Login],
    *,
    address: str,
    base: str,
    ca_path: str,
    passwords: Mapping[str, str],
    central_passwords: Mapping[str, str],
) -> str:
    """Return the configuration of the bridge's Mosquitto; it holds the passwords of both sides.

    `address` is host:port of the central broker, `base` that of this gateway's topics there, `ca_path` its
    authority on the edge's machine, empty for the system's authorities.
    """
    (up, down), (out, into), own = bridge_logins(config), _passing(logins), f"{config.base}/"
    here = f"127.0.0.1:{edge_port(config)}"
    away = f"{address}\n" + (f"bridge_cafile {ca_path}" if ca_path else "bridge_capath /etc/ssl/certs")
    blocks = [
        ("edge-telemetry", BRIDGE_UP, passwords, here, out, "in", config.base),
        ("telemetry", up, central_passwords, away, out, "out", base),
    ]
    if into:
        blocks += [
            ("commands", down, central_passwords, away, into, "in", base),
            ("edge-commands", BRIDGE_DOWN, passwords, here, into, "out", config.base),
        ]
    parts = [_HEAD]
    for name, login, known, place, filters, direction, other in blocks:
        is_notified = name == "telemetry"
        parts += [
            f"connection {config.gateway.name}-{name}",
            f"address {place}",
            f"remote_clientid {login}\nremote_username {login}\nremote_password {known[login]}",
            _CLEAN if name.endswith("commands") else _WAITING,
            "restart_timeout 5 120" if is_notified else "restart_timeout 2 30",
            f"notification_topic {base}/{NOTICE}" if is_notified else "notifications false",
        ]
        for each in filters:  # below the gateway's base the other side has another one
            pattern = each.removeprefix(own)
            parts.append(f"topic {pattern} {direction} 1" + (f" {own} {other}/" if pattern != each else ""))
        parts.append("")
    return "\n".join(parts)


def _passing(logins: Sequence[Login]) -> tuple[list[str], list[str]]:
    """Return the filters at the edge of the telemetry that goes out, and of the commands that come in."""
    named = {login.name: login for login in logins}
    return named[BRIDGE_UP].reads, named[BRIDGE_DOWN].writes if BRIDGE_DOWN in named else []


def _moved(config: Config, filters: list[str], base: str) -> list[str]:
    """Return filters as they are at the central broker."""
    own = f"{config.base}/"
    return [base + each.removeprefix(config.base) if each.startswith(own) else each for each in filters]

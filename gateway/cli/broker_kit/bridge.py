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

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from gateway.cli.broker_kit.logins import (
    Login,
    Role,
    birth_topic,
    edge_topics,
    gateway_login,
    remote_clients,
    sparkplug_here,
)
from gateway.config.schema import Config
from gateway.config.values import is_loopback
from gateway.errors import UsageError

DEFAULT_PORT = 8883
LOOPBACK_PORT = 18883  # of the edge's broker, for the bridge: TLS would gain nothing there
BRIDGE_PORT = 18884  # of the bridge itself; no login may use it
EDGE_LOGINS = ("bridge-up", "bridge-down")
NOTICE = "bridge"  # below the central base: 1 while the telemetry's connection stands, else 0; retained

_BRANCHES = ("gateway/#", "starter/#", "result/#", "audit")


@dataclass(frozen=True, slots=True)
class CentralBroker:
    """The central broker, and the base of this gateway's topics there."""

    host: str
    port: int
    base: str
    ca_path: str  # of its authority on the edge's machine; empty: the system's authorities


@dataclass(frozen=True, slots=True)
class _Connection:
    name: str
    address: str
    login: str
    password: str
    topics: tuple[str, ...]
    is_clean: bool  # nothing waits
    tls: str = ""  # the line that names the authority; empty: plain, on loopback
    notice: str = ""  # topic that shows whether it stands


def bridge_logins(config: Config) -> tuple[str, str]:
    """Return the two logins of the bridge at the central broker: for telemetry, and for commands."""
    name = gateway_login(config)
    return f"{name}-up", f"{name}-down"


def edge_port(config: Config) -> int:
    """Return the port of the edge's broker on 127.0.0.1: its own, or with TLS one for the bridge alone."""
    host = config.mqtt.host
    is_elsewhere = is_loopback(host) and host not in ("localhost", "127.0.0.1")
    return LOOPBACK_PORT if config.mqtt.is_tls or is_elsewhere else config.mqtt.port


def edge_logins(config: Config, base: str) -> tuple[Login, ...]:
    """Return the bridge's two logins at the edge: one reads the telemetry, one writes remote commands."""
    up, down = EDGE_LOGINS
    reads = [_filter(*each) for each in telemetry(config, base)]
    logins = [Login(up, "", {Role.BRIDGE_UP}, reads, [])]
    if passing := commands(config, base):
        logins.append(Login(down, "", {Role.BRIDGE_DOWN}, [], [_filter(*each) for each in passing]))
    return tuple(logins)


def telemetry(config: Config, base: str) -> tuple[tuple[str, str], ...]:
    """Return what goes out, as pattern and local prefix; `base` is the central broker's."""
    passing = [(each, f"{config.base}/") for each in _BRANCHES]
    if _has_home_assistant(config, base) and config.home_assistant is not None:
        passing.append((f"{config.home_assistant.discovery_prefix}/device/+/config", ""))
    table = sparkplug_here(config)
    if table is not None:
        edge = edge_topics(config, table)
        passing += [(edge.of(kind), "") for kind in ("NBIRTH", "NDATA", "NDEATH")]
        passing += [(f"{edge.of(kind)}/+", "") for kind in ("DBIRTH", "DDATA", "DDEATH")]
    return tuple(passing)


def commands(config: Config, base: str) -> tuple[tuple[str, str], ...]:
    """Return what comes in, as pattern and local prefix: commands of remote operators alone."""
    passing = [(f"+/{client}/+", f"{config.base}/command/") for client in remote_clients(config)]
    if _has_home_assistant(config, base):
        passing.append((birth_topic(config), ""))
    table = sparkplug_here(config)
    if table is not None:
        edge = edge_topics(config, table)
        passing.append((edge.node_command, ""))
        if table.commands and table.operator in remote_clients(config):
            passing.append((edge.device_commands, ""))
    return tuple(passing)


def bridge_conf(
    config: Config, central: CentralBroker, edge_passwords: Mapping[str, str], passwords: Mapping[str, str]
) -> str:
    """Return the configuration of the bridge's Mosquitto; it holds passwords."""
    here, there = f"127.0.0.1:{edge_port(config)}", f"{central.host}:{central.port}"
    tls = f"bridge_cafile {central.ca_path}" if central.ca_path else "bridge_capath /etc/ssl/certs"
    edge_up, edge_down = EDGE_LOGINS
    up, down = bridge_logins(config)
    out = telemetry(config, central.base)
    waiting, notice = _lines(out, config.base, "in"), f"{central.base}/{NOTICE}"
    sent = _lines(out, config.base, "out", central.base)
    connections = [
        _Connection("edge-telemetry", here, edge_up, edge_passwords[edge_up], waiting, is_clean=False),
        _Connection("telemetry", there, up, passwords[up], sent, is_clean=False, tls=tls, notice=notice),
    ]
    if passing := commands(config, central.base):
        taken = _lines(passing, config.base, "in", central.base)
        given = _lines(passing, config.base, "out")
        connections += [
            _Connection("commands", there, down, passwords[down], taken, is_clean=True, tls=tls),
            _Connection("edge-commands", here, edge_down, edge_passwords[edge_down], given, is_clean=True),
        ]
    return "\n".join([_HEAD, *("\n".join(_block(config, each)) for each in connections)])


def central_logins(config: Config, base: str) -> tuple[Login, ...]:
    """Return who logs in at the central broker for this site, with rights below this site's base only.

    UsageError for an operator with the name of one of the bridge's logins: it would have the bridge's rights.
    """
    up, down = bridge_logins(config)
    writes = [_moved(_filter(*each), config.base, base) for each in telemetry(config, base)]
    logins = [Login(up, "", {Role.BRIDGE_UP}, [], [*writes, f"{base}/{NOTICE}"])]
    if passing := commands(config, base):
        reads = [_moved(_filter(*each), config.base, base) for each in passing]
        logins.append(Login(down, "", {Role.BRIDGE_DOWN}, reads, []))
    seen = [f"{base}/gateway/#", f"{base}/starter/#", f"{base}/{NOTICE}"]
    for client in remote_clients(config):
        if client in (up, down):
            raise UsageError(
                f"the operator {client} has the name of the bridge's login at the central broker"
            )
        own = [*seen, f"{base}/result/+/{client}"]
        logins.append(Login(client, client, {Role.OPERATOR}, own, [f"{base}/command/+/{client}/#"]))
    return tuple(logins)


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


def _block(config: Config, connection: _Connection) -> Iterator[str]:
    yield f"connection {config.gateway.name}-{connection.name}"
    yield f"address {connection.address}"
    if connection.tls:
        yield connection.tls
    yield f"remote_clientid {connection.login}"
    yield f"remote_username {connection.login}"
    yield f"remote_password {connection.password}"
    yield f"bridge_protocol_version {'mqttv50' if connection.is_clean else 'mqttv311'}"
    yield f"# {'a command never waits' if connection.is_clean else 'what cannot be sent now waits'}"
    yield f"cleansession {'true' if connection.is_clean else 'false'}"
    if connection.is_clean:
        yield "bridge_outgoing_retain false"
    yield "keepalive_interval 15"
    if connection.tls and not connection.is_clean:
        yield "# Mosquitto 2.0.11 queues everything retained with each attempt to connect: so few of them"
        yield "restart_timeout 5 120"
    else:
        yield "restart_timeout 2 30"
    if connection.notice:
        yield "notifications true"
        yield f"notification_topic {connection.notice}"
    else:
        yield "notifications false"
    yield from (f"topic {each}" for each in connection.topics)
    yield ""


def _has_home_assistant(config: Config, base: str) -> bool:
    """Return whether discovery may pass: it names the topics of the edge, so they must be the same there."""
    return config.home_assistant is not None and base == config.base


def _lines(
    passing: tuple[tuple[str, str], ...], own: str, direction: str, base: str | None = None
) -> tuple[str, ...]:
    """Return `topic` lines; the other side's prefix is the same, or of another base."""
    return tuple(
        f"{pattern} {direction} 1" + (f" {prefix} {_moved(prefix, own, base or own)}" if prefix else "")
        for pattern, prefix in passing
    )


def _filter(pattern: str, prefix: str) -> str:
    return prefix + pattern


def _moved(topic: str, own: str, base: str) -> str:
    return f"{base}{topic.removeprefix(own)}" if topic.startswith(f"{own}/") else topic

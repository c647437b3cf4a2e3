"""Writes a kit: the broker's configuration, access list, passwords and certificates, and the bridge's.

It never replaces a kit unasked: an update draws no stored password and makes no authority again.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gateway.cli.broker_kit import certificates
from gateway.cli.broker_kit.bridge import (
    BRIDGE_PORT,
    LOOPBACK_PORT,
    CentralBroker,
    bridge_conf,
    central_logins,
    edge_port,
    passing,
)
from gateway.cli.broker_kit.certificates import CA, CA_KEY, CERT, KEY
from gateway.cli.broker_kit.folder import (
    CENTRAL,
    CENTRAL_CA,
    FOLDER,
    SETTINGS,
    drawn_passwords,
    replaced,
    write_logins,
    write_private,
)
from gateway.cli.broker_kit.logins import KitSettings, Login, access_list, logins_of
from gateway.config.schema import Config
from gateway.config.values import TOPIC_PATTERN, is_loopback
from gateway.errors import StartError, UsageError

INSTALLED = "/etc/mosquitto/starter-gateway"  # where the files lie that Mosquitto reads
DEFAULT_PORT = 8883
_BRIDGE = re.compile(r"([A-Za-z0-9](?:[A-Za-z0-9._-]*[A-Za-z0-9])?)(?::([0-9]{1,5}))?")


@dataclass(frozen=True, slots=True)
class GivenFiles:
    """What a plant gives of its own: authority, the broker's certificate and key; the central authority.

    `like` is the kit of another gateway: its authority, and its passwords for logins of the same name.
    """

    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None
    bridge_ca: Path | None = None
    like: Path | None = None


def read_settings(folder: Path) -> KitSettings:
    """Return what a kit was made of; UsageError when there is none."""
    try:
        return KitSettings.model_validate_json((folder / SETTINGS).read_text("utf-8"))
    except (OSError, ValueError) as error:
        why = (error.strerror if isinstance(error, OSError) else None) or error
        raise UsageError(f"{folder / SETTINGS}: no kit that can be read: {why} (write one first)") from error


def central_of(config: Config, settings: KitSettings) -> CentralBroker | None:
    """Return the central broker, None without a bridge; UsageError for what no such bridge can have."""
    if not settings.bridge:
        return None
    address, base = _BRIDGE.fullmatch(settings.bridge), settings.central_base(config)
    port = int(address[2] or DEFAULT_PORT) if address else 0
    if address is None or not 0 < port < 65536:
        raise UsageError(f"--bridge {settings.bridge!r} is no HOST[:PORT] (a name, or an IPv4 address)")
    if not re.fullmatch(TOPIC_PATTERN, base):
        hint = f"levels of a-z, A-Z, 0-9, _ . and -, e.g. acme/site1/{config.gateway.name}"
        raise UsageError(f"--bridge-base {base!r} is no base of topics ({hint})")
    if config.mqtt.port in (LOOPBACK_PORT, BRIDGE_PORT):
        raise UsageError(f"port {config.mqtt.port} is the bridge's own (give mqtt.url another)")
    for topics in passing(config, settings):
        if spaced := [each for each in topics if " " in each]:
            what = f"{spaced[0]}: Mosquitto's bridges take no space in a topic"
            raise UsageError(f"{what} (rename it in [sparkplug])")
    return CentralBroker(
        f"{address[1]}:{port}", base, f"{INSTALLED}/{CENTRAL_CA}" if settings.has_bridge_ca else ""
    )


def write_kit(
    config: Config, folder: Path, settings: KitSettings, given: GivenFiles, *, is_update: bool
) -> tuple[Login, ...]:
    """Write the kit and return its logins; StartError when the disk or openssl refuses.

    What is refused changes nothing in the folder.
    """
    logins, central = logins_of(config, settings), central_of(config, settings)
    there = () if central is None else central_logins(config, settings)
    old = [each for each in (folder if is_update else None, given.like) if each is not None]
    try:
        with replaced(folder) as stage:
            passwords = _passwords(logins, old)
            write_logins(stage, access_list(logins), passwords)
            _certificates(config, stage, settings, given, old)
            conf = broker_conf(config, has_bridge=central is not None)
            (stage / "mosquitto.conf").write_text(conf, "utf-8")
            if central is not None:
                theirs = _passwords(there, [each / CENTRAL for each in old])
                (stage / CENTRAL).mkdir(mode=0o700)
                write_logins(stage / CENTRAL, access_list(there), theirs)
                text = bridge_conf(config, settings, central, passwords=passwords, central_passwords=theirs)
                write_private(stage / "bridge.conf", text)
                authority = given.bridge_ca or next((each / CENTRAL_CA for each in old), None)
                if settings.has_bridge_ca and authority is not None:
                    certificates.copy_pem(authority, stage / CENTRAL_CA)
            for public in (CA, CERT, CENTRAL_CA):
                if (stage / public).exists():
                    (stage / public).chmod(0o644)
            (stage / SETTINGS).write_text(settings.model_dump_json(indent=2) + "\n", "utf-8")
    except OSError as error:
        what = f"{error.filename or folder}: {error.strerror or error}"
        raise StartError(what, "choose another folder") from error
    return logins


def _passwords(logins: Sequence[Login], old: Sequence[Path]) -> dict[str, str]:
    return drawn_passwords([login.name for login in logins], [each / FOLDER for each in old])


def broker_conf(config: Config, *, has_bridge: bool) -> str:
    """Return Mosquitto's configuration, for its folder conf.d."""
    host = config.mqtt.host
    address = "" if not is_loopback(host) else " 127.0.0.1" if host == "localhost" else f" {host}"
    listeners = [f"{config.mqtt.port}{'' if config.mqtt.is_tls else address}"]
    if has_bridge and edge_port(config) == LOOPBACK_PORT:
        listeners.append(f"{LOOPBACK_PORT} 127.0.0.1")  # for the bridge
    lines = [f"listener {each}\nuse_username_as_clientid true" for each in listeners]
    if config.mqtt.is_tls:
        files = f"certfile {INSTALLED}/{CERT}\nkeyfile {INSTALLED}/{KEY}\ntls_version tlsv1.2"
        lines[0] = f"{lines[0]}\n{files}"
    queued = 100_000 if has_bridge else 1000
    return "\n".join([_HEAD, *lines, _REST.format(folder=INSTALLED, queued=queued)])


_HEAD = """\
# Mosquitto for Starter Gateway, in /etc/mosquitto/conf.d/; written by `starter-gateway broker-kit`.
#
# A client's id is its login's name, whatever it says: no other client can disconnect it and receive its
# stops by taking its id. So each login has one connection at a time: give each program a login of its own.
# The line is a listener's own: a further listener needs it too.
"""
_REST = """
allow_anonymous false
password_file {folder}/passwords
acl_file {folder}/acl

# Retained values and waiting sessions outlive a restart; every 5 s bounds what a power failure takes.
# (The distribution's mosquitto.conf says where: persistence_location /var/lib/mosquitto/)
autosave_interval 5
# Messages for a slow client beyond this are dropped. A longer queue saves no stop from a flood: the stop
# waits behind it. With a bridge so much of the telemetry outlasts an outage. (0: 2.0.16 drops everything.)
max_queued_messages {queued}
max_packet_size 1048576
# A stop must not wait for the acknowledgement of what went before it.
set_tcp_nodelay true
"""


def _certificates(
    config: Config, stage: Path, settings: KitSettings, given: GivenFiles, old: Sequence[Path]
) -> None:
    """Put authority, certificate and key into the folder: the plant's, the previous ones, or made here."""
    if given.ca and given.cert and given.key:
        for source, name in ((given.ca, CA), (given.cert, CERT), (given.key, KEY)):
            certificates.copy_pem(source, stage / name)
        certificates.require_pair(stage, config.mqtt.host)
    elif before := next((each for each in old if (each / CA).exists()), None):
        for name in (CA, CA_KEY, CERT, KEY):
            if (before / name).exists():
                certificates.copy_pem(before / name, stage / name)
    if not config.mqtt.is_tls or given.ca:
        return
    names = tuple(dict.fromkeys((*settings.hosts, config.mqtt.host)))  # asked for, and mqtt.url's
    if not (stage / CA).exists():
        certificates.make_authority(stage, config.gateway.name)
    elif not (stage / CA_KEY).exists():  # of the plant, or the authority's key lies elsewhere
        missing = certificates.names_missing(stage, names) if (stage / CERT).exists() else names
        if missing:
            hint = f"fetch {CA_KEY} back into the kit, or give --ca, --cert and --key"
            raise UsageError(f"no certificate here is for {', '.join(missing)} ({hint})")
        return
    certificates.sign_broker(stage, names)

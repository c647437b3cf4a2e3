"""Writes a kit: the broker's configuration, access list, passwords and certificates, and the bridge's.

It never replaces a kit unasked: an update draws no stored password and makes no authority again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from gateway.cli.broker_kit import certificates
from gateway.cli.broker_kit.bridge import LOOPBACK_PORT, bridge_conf, central_logins, edge_port
from gateway.cli.broker_kit.certificates import CA, CA_KEY, CERT, KEY
from gateway.cli.broker_kit.folder import CENTRAL, CENTRAL_CA, replaced, write_logins, write_private
from gateway.cli.broker_kit.logins import logins_of
from gateway.cli.broker_kit.rights import Login
from gateway.cli.broker_kit.settings import SETTINGS, KitSettings
from gateway.config import Config, is_loopback
from gateway.errors import StartError, UsageError

INSTALLED = "/etc/mosquitto/starter-gateway"  # where the files lie that Mosquitto reads
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


def write_kit(
    config: Config, folder: Path, settings: KitSettings, given: Mapping[str, Path], old: Sequence[Path]
) -> tuple[Login, ...]:
    """Write the kit and return its logins; StartError when the disk or openssl refuses.

    `given` are the plant's own files, by `ca`, `cert`, `key` and `bridge_ca`. Passwords and certificates of
    the kits `old` stay; the first that has one counts. A refusal changes nothing in the folder.
    """
    logins, address = logins_of(config, settings), settings.central_address()
    there = central_logins(config, logins, settings.central_base(config)) if settings.bridge else ()
    try:
        with replaced(folder) as stage:
            passwords = write_logins(stage, logins, old)
            _put_certificates(config, stage, settings, given, old)
            (stage / "mosquitto.conf").write_text(broker_conf(config, has_bridge=bool(there)), "utf-8")
            if there:
                text = bridge_conf(
                    config,
                    logins,
                    address=address,
                    base=settings.central_base(config),
                    ca_path=f"{INSTALLED}/{CENTRAL_CA}" if settings.has_bridge_ca else "",
                    passwords=passwords,
                    central_passwords=write_logins(stage / CENTRAL, there, [each / CENTRAL for each in old]),
                )
                write_private(stage / "bridge.conf", text)
                authorities = [given.get("bridge_ca"), *(each / CENTRAL_CA for each in old)]
                if settings.has_bridge_ca and (authority := next(filter(None, authorities), None)):
                    certificates.copy_pem(authority, stage / CENTRAL_CA)
            for public in (CA, CERT, CENTRAL_CA):
                if (stage / public).exists():
                    (stage / public).chmod(0o644)
            (stage / SETTINGS).write_text(settings.model_dump_json(indent=2) + "\n", "utf-8")
    except OSError as error:
        what = f"{error.filename or folder}: {error.strerror or error}"
        raise StartError(what, "choose another folder") from error
    return logins


def broker_conf(config: Config, *, has_bridge: bool) -> str:
    """Return Mosquitto's configuration, for its folder conf.d."""
    host = config.mqtt.host
    address = "" if not is_loopback(host) else " 127.0.0.1" if host == "localhost" else f" {host}"
    listeners = [f"{config.mqtt.port}{'' if config.mqtt.is_tls else address}"]
    if has_bridge and edge_port(config) == LOOPBACK_PORT:
        listeners.append(f"{LOOPBACK_PORT} 127.0.0.1")  # for the bridge
    lines = [f"listener {each}\nuse_username_as_clientid true" for each in listeners]
    if config.mqtt.is_tls:
        lines[0] += f"\ncertfile {INSTALLED}/{CERT}\nkeyfile {INSTALLED}/{KEY}\ntls_version tlsv1.2"
    queued = 100_000 if has_bridge else 1000
    return "\n".join([_HEAD, *lines, _REST.format(folder=INSTALLED, queued=queued)])


def _put_certificates(
    config: Config, stage: Path, settings: KitSettings, given: Mapping[str, Path], old: Sequence[Path]
) -> None:
    """Put authority, certificate and key into the folder: the plant's, the previous ones, or made here."""
    if "ca" in given:
        for key, name in (("ca", CA), ("cert", CERT), ("key", KEY)):
            certificates.copy_pem(given[key], stage / name)
        certificates.require_pair(stage, config.mqtt.host)
        return
    for before in [each for each in old if (each / CA).exists()][:1]:
        for name in (CA, CA_KEY, CERT, KEY):
            if (before / name).exists():
                certificates.copy_pem(before / name, stage / name)
    if not config.mqtt.is_tls:
        return
    names = tuple(dict.fromkeys((*settings.hosts, config.mqtt.host)))
    if not (stage / CA).exists():
        certificates.make_authority(stage, config.gateway.name)
    if (stage / CA_KEY).exists():
        certificates.sign_broker(stage, names)
    # The authority's key is the plant's, or lies elsewhere: the certificate stays as it is.
    elif missing := certificates.names_missing(stage, names) if (stage / CERT).exists() else names:
        hint = f"fetch {CA_KEY} back into the kit, or give --ca, --cert and --key"
        raise UsageError(f"no certificate here is for {', '.join(missing)} ({hint})")

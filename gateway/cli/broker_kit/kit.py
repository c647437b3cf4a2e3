"""Writes a kit: the broker's configuration, access list, passwords and certificates, and the bridge's.

It never replaces a kit unasked: an update draws no stored password and makes no authority anew.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gateway.cli.broker_kit.bridge import (
    BRIDGE_PORT,
    DEFAULT_PORT,
    LOOPBACK_PORT,
    CentralBroker,
    bridge_conf,
    central_logins,
    commands,
    edge_logins,
    edge_port,
    telemetry,
)
from gateway.cli.broker_kit.certificates import (
    CA,
    CA_KEY,
    CERT,
    KEY,
    make_authority,
    names_missing,
    require_pair,
    sign_broker,
)
from gateway.cli.broker_kit.folder import (
    CENTRAL,
    CENTRAL_CA,
    FOLDER,
    SETTINGS,
    drawn_passwords,
    password_file,
    replaced,
    write_private,
)
from gateway.cli.broker_kit.logins import KitSettings, Login, access_list, logins_of
from gateway.config.schema import Config
from gateway.config.values import TOPIC_PATTERN, is_loopback
from gateway.errors import StartError, UsageError

INSTALLED = "/etc/mosquitto/starter-gateway"  # where the files lie that Mosquitto reads
_BRIDGE = re.compile(r"([A-Za-z0-9](?:[A-Za-z0-9._-]*[A-Za-z0-9])?)(?::([0-9]{1,5}))?")
_BASE = re.compile(TOPIC_PATTERN)
_BRIDGE_PORTS = (LOOPBACK_PORT, BRIDGE_PORT)


def central_of(config: Config, settings: KitSettings) -> CentralBroker | None:
    """Return the central broker; None without a bridge, UsageError for a wrong address."""
    if not settings.bridge:
        return None
    address = _BRIDGE.fullmatch(settings.bridge)
    if address is None or (address[2] and not 0 < int(address[2]) < 65536):
        raise UsageError(f"--bridge {settings.bridge!r} is no HOST[:PORT] (a name, or an IPv4 address)")
    base = (settings.bridge_base or config.base).replace("{gateway}", config.gateway.name)
    if not _BASE.fullmatch(base):
        hint = f"levels of a-z, A-Z, 0-9, _ . and -, e.g. acme/site1/{config.gateway.name}"
        raise UsageError(f"--bridge-base {base!r} is no base of topics ({hint})")
    ca_path = f"{INSTALLED}/{CENTRAL_CA}" if settings.has_bridge_ca else ""
    return CentralBroker(address[1], int(address[2] or DEFAULT_PORT), base, ca_path)


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


def certificate_names(config: Config, settings: KitSettings) -> tuple[str, ...]:
    """Return the names of the broker in a certificate made here: those asked for, and mqtt.url's."""
    return tuple(dict.fromkeys((*settings.hosts, config.mqtt.host)))


def kit_logins(config: Config, settings: KitSettings) -> tuple[Login, ...]:
    """Return every login at the edge's broker, the bridge's with them."""
    logins, central = logins_of(config, settings), central_of(config, settings)
    bridging = () if central is None else edge_logins(config, central.base)
    if taken := {login.name for login in logins} & {login.name for login in bridging}:
        raise UsageError(f"two logins have the name {min(taken)} (the bridge has one of that name)")
    if central is not None:
        _require_bridgeable(config, central.base)
    return (*logins, *bridging)


def _require_bridgeable(config: Config, base: str) -> None:
    """UsageError for what a bridge of Mosquitto cannot have."""
    if config.mqtt.port in _BRIDGE_PORTS:
        raise UsageError(f"port {config.mqtt.port} is the bridge's own (give mqtt.url another)")
    for pattern, _ in (*telemetry(config, base), *commands(config, base)):
        if " " in pattern:
            raise UsageError(
                f"{pattern}: Mosquitto's bridges take no space in a topic (rename it in [sparkplug])"
            )


def write_kit(
    config: Config, folder: Path, settings: KitSettings, given: GivenFiles, *, is_update: bool
) -> tuple[Login, ...]:
    """Write the kit and return its logins; StartError when the disk or openssl refuses.

    What is refused changes nothing in the folder.
    """
    logins, central = kit_logins(config, settings), central_of(config, settings)
    there = () if central is None else central_logins(config, central.base)
    try:
        with replaced(folder) as stage:
            old = [each for each in (folder if is_update else None, given.like) if each is not None]
            passwords = _store_passwords(stage, logins, old)
            write_private(stage / "passwords", password_file(passwords))
            write_private(stage / "acl", access_list(logins))
            _certificates(config, stage, settings, given, old)
            conf = broker_conf(config, has_bridge=central is not None)
            (stage / "mosquitto.conf").write_text(conf, "utf-8")
            if central is not None:
                _write_bridge(config, stage, central, passwords, there, old)
                _central_authority(stage, settings, given, old)
            (stage / SETTINGS).write_text(settings.model_dump_json(indent=2) + "\n", "utf-8")
    except OSError as error:
        raise StartError(
            f"{error.filename or folder}: {error.strerror or error}", "choose another folder"
        ) from error
    return logins


def broker_conf(config: Config, *, has_bridge: bool) -> str:
    """Return Mosquitto's configuration, for its folder conf.d."""
    lines = [_HEAD]
    if config.mqtt.is_tls:
        lines += [f"listener {config.mqtt.port}", _OF_LISTENER]
        lines += [f"certfile {INSTALLED}/{CERT}", f"keyfile {INSTALLED}/{KEY}", "tls_version tlsv1.2"]
    else:
        lines += [f"listener {config.mqtt.port}{_loopback_of(config.mqtt.host)}", _OF_LISTENER]
    if has_bridge and edge_port(config) == LOOPBACK_PORT:
        lines += [f"# for the bridge\nlistener {LOOPBACK_PORT} 127.0.0.1", _OF_LISTENER]
    queued = _BRIDGED_QUEUE if has_bridge else _QUEUE
    return "\n".join([*lines, _RIGHTS.format(folder=INSTALLED), _RESOURCES.format(queued=queued)])


def _loopback_of(host: str) -> str:
    if not is_loopback(host):
        return ""
    return " 127.0.0.1" if host == "localhost" else f" {host}"


_HEAD = """\
# Mosquitto for Starter Gateway, in /etc/mosquitto/conf.d/; written by `starter-gateway broker-kit`.
#
# A client's id is its login's name, whatever it says: no other client can disconnect it and receive its
# stops by taking its id. So each login has one connection at a time: give each program a login of its own.
# The line is a listener's own: a further listener needs it too.
"""
_OF_LISTENER = "use_username_as_clientid true"
_RIGHTS = """
allow_anonymous false
password_file {folder}/passwords
acl_file {folder}/acl
"""
_RESOURCES = """\
# Retained values and waiting sessions outlive a restart; every 5 s bounds what a power failure takes.
# (The distribution's mosquitto.conf says where: persistence_location /var/lib/mosquitto/)
autosave_interval 5
{queued}
max_packet_size 1048576
# A stop must not wait for the acknowledgement of what went before it.
set_tcp_nodelay true
"""
_QUEUE = """\
# What waits for a slow client beyond this is dropped, without a word to the sender. More of it would not
# save a stop from a flood: the stop, and all acknowledgements, would wait behind it. (0 is no way out: 2.0.16
# then drops everything.)
max_queued_messages 1000"""
_BRIDGED_QUEUE = """\
# What waits for a slow client, or for the bridge while its link is cut, beyond this is dropped, without a
# word to the sender: so much of the telemetry outlasts an outage. (0 is no way out: 2.0.16 then drops all.)
max_queued_messages 100000"""


def _store_passwords(stage: Path, logins: tuple[Login, ...], old: Sequence[Path]) -> dict[str, str]:
    """Write each login's password, the one in kits of before if any, into a file of its own; return them."""
    stored = stage / FOLDER
    passwords = drawn_passwords([login.name for login in logins], *(each / FOLDER for each in old))
    stored.mkdir(mode=0o700)
    for name, password in passwords.items():
        write_private(stored / name, f"{password}\n")
    return passwords


def _certificates(
    config: Config, stage: Path, settings: KitSettings, given: GivenFiles, old: Sequence[Path]
) -> None:
    """Put authority, certificate and key into the folder: the plant's, those of before, or made here."""
    if given.ca and given.cert and given.key:
        for source, name in ((given.ca, CA), (given.cert, CERT), (given.key, KEY)):
            _copy(source, stage / name)
        require_pair(stage, config.mqtt.host)
    elif before := [each for each in old if (each / CA).exists()]:
        for name in (CA, CA_KEY, CERT, KEY):
            if (before[0] / name).exists():
                _copy(before[0] / name, stage / name)
    if config.mqtt.is_tls and not given.ca:
        _sign(config, stage, certificate_names(config, settings))
    for name in (CA, CERT):
        if (stage / name).exists():
            (stage / name).chmod(0o644)


def _sign(config: Config, stage: Path, names: tuple[str, ...]) -> None:
    """Sign the broker's certificate; without the authority's key the present one must do."""
    if not (stage / CA).exists():
        make_authority(stage, config.gateway.name)
    elif not (stage / CA_KEY).exists():
        missing = names_missing(stage, names) if (stage / CERT).exists() else names
        if missing:
            hint = f"fetch {CA_KEY} back into the kit, or give --ca, --cert and --key"
            raise UsageError(f"no certificate here is for {', '.join(missing)} ({hint})")
        return  # of the plant, or its authority's key lies elsewhere
    sign_broker(stage, names)


def _write_bridge(
    config: Config,
    stage: Path,
    central: CentralBroker,
    edge_passwords: Mapping[str, str],
    logins: tuple[Login, ...],
    old: Sequence[Path],
) -> None:
    """Write the bridge's configuration, and the central broker's access list and passwords for this site."""
    there = stage / CENTRAL
    there.mkdir(mode=0o700)
    passwords = _store_passwords(there, logins, [each / CENTRAL for each in old])
    write_private(there / "acl", access_list(logins))
    write_private(there / "passwords", password_file(passwords))
    write_private(stage / "bridge.conf", bridge_conf(config, central, edge_passwords, passwords))


def _central_authority(stage: Path, settings: KitSettings, given: GivenFiles, old: Sequence[Path]) -> None:
    source = given.bridge_ca or next((each / CENTRAL_CA for each in old), None)
    if settings.has_bridge_ca and source is not None:
        _copy(source, stage / CENTRAL_CA)
        (stage / CENTRAL_CA).chmod(0o644)


def _copy(source: Path, target: Path) -> None:
    """Copy a PEM file, for its owner only; UsageError when it is none."""
    text = source.read_bytes().decode("utf-8", "replace")
    if "-----BEGIN " not in text:
        raise UsageError(f"{source} is no PEM file (openssl x509 or pkey, -inform DER, makes one)")
    if "ENCRYPTED" in text:
        raise UsageError(
            f"{source} has a passphrase, which the broker cannot ask for (openssl pkey removes it)"
        )
    write_private(target, text)

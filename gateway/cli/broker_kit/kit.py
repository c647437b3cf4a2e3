"""Writes a kit: the broker's configuration, access list, passwords and certificates, and the bridge's.

A kit is made in a private folder inside its folder and moved over when it is complete, so that a refusal
changes nothing. An update draws no stored password and makes no authority again.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from gateway.cli.broker_kit.bridge import LOOPBACK_PORT, bridge_conf, edge_port
from gateway.cli.broker_kit.certificates import CA, CA_KEY, CERT, KEY, complete_certificates
from gateway.cli.broker_kit.logins import FOLDER, central_logins, logins_of, write_logins
from gateway.cli.broker_kit.rights import Login
from gateway.cli.broker_kit.settings import SETTINGS, KitSettings
from gateway.config import Config, is_loopback
from gateway.errors import StartError, UsageError

CENTRAL = "central"  # the part of the kit for the central broker
CENTRAL_CA = "central-ca.pem"
INSTALLED = "/etc/mosquitto/starter-gateway"  # where the files lie that Mosquitto reads

_PUBLIC = (CA, CERT, CENTRAL_CA)
_CHANGING = (FOLDER, "bridge.conf", CENTRAL, CENTRAL_CA)  # not in every kit, or not with the same files
_STAGE = ".new-"
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


def is_kit(folder: Path) -> bool:
    """Return whether a kit was written into this folder."""
    return (folder / SETTINGS).exists()


def write_kit(config: Config, folder: Path, settings: KitSettings) -> tuple[Login, ...]:
    """Write the kit and return its logins; StartError when the disk or openssl refuses.

    Passwords and certificates that are in the folder stay, also the central broker's authority.
    """
    logins, base = logins_of(config, settings), settings.central_base(config)
    there = central_logins(config, base) if base else ()
    try:
        with _replaced(folder) as stage:
            for name in (CA, CA_KEY, CERT, KEY, *((CENTRAL_CA,) if there else ())):
                with suppress(FileNotFoundError):
                    shutil.copyfile(folder / name, stage / name)
            if config.mqtt.is_tls:
                hosts = dict.fromkeys((*settings.hosts, config.mqtt.host))
                complete_certificates(stage, [*hosts], gateway=config.gateway.name)
            write_logins(stage, logins, stored=folder)
            (stage / "mosquitto.conf").write_text(broker_conf(config, has_bridge=bool(there)), "utf-8")
            if there:
                ca_path = f"{INSTALLED}/{CENTRAL_CA}" if (stage / CENTRAL_CA).exists() else ""
                write_logins(stage / CENTRAL, there, stored=folder / CENTRAL)
                text = bridge_conf(config, settings, logins, there, ca_path=ca_path)
                (stage / "bridge.conf").write_text(text, "utf-8")
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
    lines = [f"listener {place}\nuse_username_as_clientid true" for place in listeners]
    if config.mqtt.is_tls:
        lines[0] += f"\ncertfile {INSTALLED}/{CERT}\nkeyfile {INSTALLED}/{KEY}\ntls_version tlsv1.2"
    queued = 100_000 if has_bridge else 1000
    return "\n".join([_HEAD, *lines, _REST.format(folder=INSTALLED, queued=queued)])


@contextmanager
def _replaced(folder: Path) -> Iterator[Path]:
    """Yield a private folder for a whole kit; without an error it then takes the place of what `folder` has.

    UsageError for a folder with other things in it; OSError by the disk.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    others = [path.name for path in folder.iterdir() if not path.name.startswith(_STAGE)]
    if others and not is_kit(folder):
        raise UsageError(f"{folder} holds no kit, but {min(others)} (choose a new or an empty folder)")
    folder.chmod(0o700)
    for killed in folder.glob(f"{_STAGE}*"):  # it has keys and passwords
        shutil.rmtree(killed)
    with TemporaryDirectory(prefix=_STAGE, dir=folder) as name:
        stage = Path(name)
        yield stage
        new = sorted(path.relative_to(stage) for path in stage.rglob("*") if path.is_file())
        # One by one, the mark of a kit at last: at a kill each file is the old or the new one.
        for path in sorted(new, key=lambda path: str(path) == SETTINGS):
            (stage / path).chmod(0o644 if str(path) in _PUBLIC else 0o600)
            (folder / path).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            (stage / path).replace(folder / path)
        for old in [path for part in _CHANGING for path in (folder / part, *(folder / part).rglob("*"))]:
            if not old.is_dir() and old.relative_to(folder) not in new:
                old.unlink(missing_ok=True)

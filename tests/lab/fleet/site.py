"""The configurations of a fleet: its gateways, the site's broker with its bridge, the central broker."""

from __future__ import annotations

from pathlib import Path

FAMILIES = ("ssw07", "ssw06", "ssw900", "sst")
SITE = "acme/site1/"  # before the topics of the site, at the central broker
BASE = "starters/"  # of every gateway, at the site's broker
OPERATOR = "fleet"
RESTART = "2 5"  # of the bridge, after the link was cut: seconds, at the least and at the most
IN_FLIGHT = 20  # messages on the bridge that are not acknowledged yet, as Mosquitto has it
ROOM = 1_000_000  # messages that a broker stores for a session whose client is away

CENTRAL = (f"max_queued_messages {ROOM}", "set_tcp_nodelay true", "log_type none")


def edge(central_port: int, *, room: int = ROOM) -> tuple[str, ...]:
    """Return the lines of the site's broker: telemetry goes out stored, commands come in only live.

    The topics that go out are listed one by one: with `#` the commands that came in would go out again.
    """
    out = [
        f"topic +/{branch} out 1 {BASE} {SITE}{BASE}"
        for branch in ("gateway/#", "starter/#", "result/#", "audit")
    ]
    common = (
        f"address 127.0.0.1:{central_port}",
        "bridge_protocol_version mqttv50",
        f"restart_timeout {RESTART}",
        "keepalive_interval 5",
    )
    return (
        f"max_queued_messages {room}",
        f"max_inflight_messages {IN_FLIGHT}",
        "set_tcp_nodelay true",
        "log_type none",
        *("connection up-telemetry", *common, "remote_clientid site1-up", "local_clientid bridge-up"),
        *("cleansession false", *out),
        *("connection down-commands", *common, "remote_clientid site1-down", "local_clientid bridge-down"),
        *("cleansession true", f"topic +/command/# in 1 {BASE} {SITE}{BASE}"),
    )


def gateway_name(number: int) -> str:
    """Return the name of a gateway, which is a level of its topics."""
    return f"g{number}"


def starter_names(starters: int) -> list[str]:
    """Return the names of every gateway's starters."""
    return [f"s{address}-{FAMILIES[address % len(FAMILIES)]}" for address in range(1, starters + 1)]


def site_text(folder: Path, number: int, *, starters: int, edge_port: int) -> str:
    """Return the configuration of a gateway: one line at 19200 bit/s, all families, the rest default."""
    parts = [
        f'[gateway]\nname = "{gateway_name(number)}"\nstate_dir = "{folder}/state-{number}"\n'
        f'[mqtt]\nurl = "mqtt://127.0.0.1:{edge_port}"\n'
        f'[[operator]]\nclient = "{OPERATOR}"\nmay = ["start", "stop"]\nstarters = ["*"]\n'
        f'[[line]]\nname = "hall"\nport = "{folder}/tty-{number}"\nbaud = 19200\nframing = "8N2"\n'
        "adapter_allowance_s = 1.0\n"  # its simulator shares the machine with all others
    ]
    parts += [
        f'[[line.starter]]\nname = "{name}"\naddress = {address}\nfamily = "{name.partition("-")[2]}"\n'
        for address, name in enumerate(starter_names(starters), 1)
    ]
    return "".join(parts)

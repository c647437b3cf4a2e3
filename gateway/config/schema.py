"""The shape of the configuration: frozen models of its tables, from `[gateway]` to `[[operator]]`.

What one value may be stands here; what several values may be together stands in `cross_checks.py`.
"""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal
from urllib.parse import SplitResult, urlsplit

from pydantic import BaseModel, ConfigDict, Field

from gateway.families.profile.load import FAMILIES

NAME_PATTERN = r"^[a-z0-9_-]+$"
FIRMWARE_PATTERN = r"^\d{1,2}\.\d{1,2}$"
GLOB_PATTERN = r"^[a-z0-9_*?-]+$"
SCHEMES = {"mqtt": 1883, "mqtts": 8883}

Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=64)]
Glob = Annotated[str, Field(pattern=GLOB_PATTERN, max_length=64)]
Text = Annotated[str, Field(min_length=1, max_length=1024)]
if TYPE_CHECKING:
    Family = str
else:
    Family = Literal[FAMILIES]  # whatever profiles there are
Baud = Literal[1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400]  # what a tty can be set to
FramingText = Literal["8N1", "8N2", "8E1", "8E2", "8O1", "8O2"]
Verb = Literal[
    "start",
    "stop",
    "reset",
    "set",
    "read",
    "jog",
    "direction",
    "local_remote",
    "general_enable",
    "output",
    "configure",
    "select",  # needs no right: a client that may do something may also select it
    "cancel",
    "lock",
    "unlock",
    "accept",
    "*",
]
TwoStepVerb = Literal[
    "start", "reset", "set", "jog", "direction", "local_remote", "general_enable", "output", "configure"
]  # never stop


class ConfigTable(BaseModel):
    """What all tables share: no unknown key, no silent conversion, nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class GatewayTable(ConfigTable):
    """`[gateway]`: who this gateway is and where it keeps what must outlive it."""

    name: Name  # a level in the topics, and the MQTT client id
    state_dir: Path = Field(default=Path("/var/lib/starter-gateway"), strict=False)
    clock: Literal["auto", "trusted", "untrusted"] = "auto"  # auto: synchronised when the kernel says so


class MqttTable(ConfigTable):
    """`[mqtt]`: the broker and the way to it; file names are relative to the configuration's folder."""

    url: Text  # mqtt://host[:1883] or mqtts://host[:8883]
    base: Text = "starters/{gateway}"
    username: Text | None = None
    password_file: Text | None = None
    ca_file: Text | None = None
    cert_file: Text | None = None  # of the client, with key_file
    key_file: Text | None = None
    client_id: Text | None = None  # None: the gateway's name
    keepalive_s: int = Field(default=15, ge=5, le=3600)
    refresh_s: float = Field(default=300.0, ge=1, le=86400)  # an unchanged value is published again
    allow_plaintext: bool = False  # mqtt:// to a broker on another machine

    @property
    def host(self) -> str:
        """Return the broker's host name or address, without brackets."""
        return urlsplit(self.url).hostname or ""

    @property
    def port(self) -> int:
        """Return the broker's TCP port: the URL's, else 1883 for mqtt and 8883 for mqtts."""
        split = urlsplit(self.url)
        return split.port or SCHEMES[split.scheme]

    @property
    def is_tls(self) -> bool:
        """Return whether the connection is encrypted."""
        return urlsplit(self.url).scheme == "mqtts"


class RulesTable(ConfigTable):
    """`[line.starter.rules]`: what the gateway demands of commands to one starter; nothing by default."""

    starts_per_hour: int | None = Field(default=None, ge=1, le=1000)  # local starts count as well
    minimum_pause_s: float | None = Field(default=None, ge=0, le=86400)  # from standstill to the next start
    feeder: Name | None = None  # its starters, of all lines, do not start at the same time
    stagger_s: float | None = Field(default=None, gt=0, le=3600)  # after another start on the feeder
    two_step: tuple[TwoStepVerb, ...] | None = Field(default=None, strict=False)  # select first, then operate


class SharedRulesTable(RulesTable):
    """`[[rules]]`: the same for several starters; a later table wins, a starter's own over all."""

    starters: tuple[Glob, ...] = Field(strict=False, min_length=1)  # names, * and ? as in a shell


class GroupTable(ConfigTable):
    """`[[group]]`: starters that can be stopped by one command; no other verb works on a group."""

    name: Name  # stands where a starter's name stands in command and result topics
    starters: tuple[Glob, ...] = Field(strict=False, min_length=1)


class SimulatedTable(ConfigTable):
    """`[line.starter.simulated]`: what `simulate` makes of a starter; the gateway itself ignores it."""

    firmware: Annotated[str, Field(pattern=FIRMWARE_PATTERN)] | None = None  # e.g. "1.30"
    parameters: dict[str, Annotated[int, Field(ge=0, le=0xFFFF)]] = {}  # by the manual's code, as on the wire
    braking_s: float = Field(default=0.0, ge=0, le=600)  # SSW-06, SSW-07: DC braking at each stop; 0: none


class StarterTable(ConfigTable):
    """`[[line.starter]]`: one machine on a line."""

    name: Name
    address: int = Field(ge=1, le=247)  # [SERIAL 2.2]
    family: Family
    every_s: float = Field(default=1.0, ge=0, le=3600)  # 0: as fast as the line allows
    model: Text | None = None  # e.g. "SSW-06 820A"; None: as the starter says
    slot: int | None = Field(default=None, ge=1, le=2)  # SSW900: of the RS-485 accessory
    response_time_s: float | None = Field(default=None, gt=0, le=10)  # None: as the manual says
    watchdog_s: float | None = Field(default=None, ge=0, le=1000)  # as set in the starter; 0: off
    fast_words: bool = False  # SSW900: points mapped onto 1500-1549, at standstill; one request reads all
    enabled: bool = True  # False: never asked, availability "disabled"
    rules: RulesTable | None = None
    simulated: SimulatedTable = SimulatedTable()


class LineTable(ConfigTable):
    """`[[line]]`: one RS-485 line and its starters."""

    name: Name
    port: Text  # an absolute path, or socket://host:port
    baud: Baud
    framing: FramingText
    adapter_allowance_s: float = Field(default=0.02, ge=0, le=1)  # what the adapter adds to a reply's way
    learn_response_times: bool = False  # wait no longer than starters have shown, though manuals allow more
    deaf_after_s: float = Field(default=15.0, ge=0, le=3600)  # silence of all starters; the port is reopened
    starters: tuple[StarterTable, ...] = Field(alias="starter", strict=False, min_length=1)


class OperatorTable(ConfigTable):
    """`[[operator]]`: what one client may ask of which starters."""

    client: Name  # the level in the command topic
    may: tuple[Verb, ...] = Field(strict=False, min_length=1)
    starters: tuple[Glob, ...] = Field(strict=False, min_length=1)  # names, * and ? as in a shell
    # What proves a command fresh: token or issued_at; issued_at alone (bridges); or even boot (old clients).
    freshness: Literal["token", "issued_at", "boot"] = "token"


class Config(ConfigTable):
    """A site, whole."""

    gateway: GatewayTable
    mqtt: MqttTable
    lines: tuple[LineTable, ...] = Field(alias="line", strict=False, min_length=1)
    operators: tuple[OperatorTable, ...] = Field(default=(), alias="operator", strict=False)
    rules: tuple[SharedRulesTable, ...] = Field(default=(), strict=False)
    groups: tuple[GroupTable, ...] = Field(default=(), alias="group", strict=False)

    @property
    def base(self) -> str:
        """Return the topics' base with the gateway's name filled in."""
        return self.mqtt.base.replace("{gateway}", self.gateway.name)

    @property
    def client_id(self) -> str:
        """Return the MQTT client id."""
        return self.mqtt.client_id or self.gateway.name


def split_url(url: str) -> tuple[SplitResult, int] | None:
    """Return the parts and the port of a broker's URL, or None when it is not one."""
    try:
        split = urlsplit(url)
        port = split.port
    except ValueError:
        return None
    if split.scheme not in SCHEMES or not split.hostname or port == 0:
        return None
    return split, port or SCHEMES[split.scheme]


def is_loopback(host: str) -> bool:
    """Return whether a host name or address never leaves this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False

"""The shape of the configuration: frozen models of its tables, from `[gateway]` to `[[operator]]`.

What one value may be stands in `values.py`; what several may be together in `cross_checks.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self, get_args, get_origin
from urllib.parse import urlsplit

from pydantic import Field, PrivateAttr, model_validator

from gateway.config.integration_tables import HomeAssistantTable, MetricsTable, SparkplugTable, WebTable
from gateway.config.site_tables import (
    DEFAULT_EVERY_S,
    Family,
    Language,
    PointsTable,
    RowTable,
    SiteAdditions,
    additions,
)
from gateway.config.values import (
    FIRMWARE_PATTERN,
    SCHEMES,
    Base,
    BrokerUrl,
    ConfigTable,
    Glob,
    Name,
    Port,
    RowPattern,
    Text,
    Title,
)
from gateway.contract import OWN_VERBS
from gateway.families import ENGLISH, Profile, extension, load_profile

DEFAULT_BASE = "starters/{gateway}"

Baud = Literal[1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400]  # what a tty can be set to
FramingText = Literal["8N1", "8N2", "8E1", "8E2", "8O1", "8O2"]
MOTOR_VERBS = (
    "start",
    "reset",
    "set",
    "jog",
    "direction",
    "local_remote",
    "general_enable",
    "output",
    "configure",
)
if TYPE_CHECKING:
    Verb = str
    TwoStepVerb = str
else:
    Verb = Literal[(*MOTOR_VERBS, "stop", "read", *OWN_VERBS, "*")]
    TwoStepVerb = Literal[MOTOR_VERBS]


class GatewayTable(ConfigTable):
    """`[gateway]`: who this gateway is and where it keeps what must outlive it."""

    name: Name = Field(description="The gateway's name: a level in the topics, and the MQTT client id.")
    state_dir: Path = Field(
        default=Path("/var/lib/starter-gateway"),
        strict=False,
        description="Folder of what must outlive the gateway: commands, audit, outbox, locks, fingerprints.",
    )
    clock: Literal["auto", "trusted", "untrusted"] = Field(
        default="auto",
        description="Whether issued_at can prove a command fresh; auto: when the kernel says synchronised.",
    )
    language: Language = Field(
        default="en",
        description="Of the names of faults, alarms and points; English where a manual has none.",
    )


class MqttTable(ConfigTable):
    """`[mqtt]`: the broker and the way to it; file names are relative to the configuration's folder."""

    url: BrokerUrl = Field(description="The broker: mqtt://host[:1883], or mqtts://host[:8883] with TLS.")
    base: Base = Field(
        default=DEFAULT_BASE,
        description="What all topics begin with; {gateway} stands for the gateway's name.",
    )
    username: Text | None = Field(default=None, description="Login at the broker; absent: none.")
    password_file: Text | None = Field(
        default=None,
        description="File with the password in one line, for its owner only; or a systemd credential, or "
        "STARTER_GATEWAY_MQTT_PASSWORD.",
    )
    ca_file: Text | None = Field(
        default=None,
        description="The certificate authority of the broker, PEM; absent: those of the system.",
    )
    cert_file: Text | None = Field(default=None, description="The client's certificate, PEM; with key_file.")
    key_file: Text | None = Field(default=None, description="The client's private key, PEM; with cert_file.")
    client_id: Text | None = Field(
        default=None, description="The MQTT client id; absent: the gateway's name. One connection each."
    )
    version: Literal["auto", "5", "3.1.1"] = Field(
        default="auto", description="The version of MQTT; auto: 5, and 3.1.1 where the broker refuses that."
    )
    keepalive_s: int = Field(
        default=6,
        ge=3,
        le=3600,
        description="Keep-alive: the broker publishes offline for a gateway silent for 1.5 times this.",
    )
    refresh_s: float = Field(
        default=300.0, ge=1, le=86400, description="After so long an unchanged value is published again."
    )
    allow_plaintext: bool = Field(
        default=False, description="Permits mqtt:// to a broker on another machine."
    )

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

    starts_per_hour: int | None = Field(
        default=None,
        ge=1,
        le=1000,
        description="Most starts in any 60 minutes; local starts count as well. Absent: no limit.",
    )
    minimum_pause_s: float | None = Field(
        default=None, ge=0, le=86400, description="Least time from standstill to the next start."
    )
    feeder: Name | None = Field(
        default=None, description="Name of the supply; its starters, of all lines, start one after the other."
    )
    stagger_s: float | None = Field(
        default=None, gt=0, le=3600, description="Least time after another start on the same feeder."
    )
    two_step: tuple[TwoStepVerb, ...] | None = Field(
        default=None, strict=False, description="Verbs that need a `select` before; never stop."
    )


class SharedRulesTable(RulesTable):
    """`[[rules]]`: the same for several starters; a later table wins, a starter's own over all."""

    starters: tuple[Glob, ...] = Field(
        strict=False,
        min_length=1,
        description="Which starters the rules hold for: names, with * and ? as in a shell.",
    )


class GroupTable(ConfigTable):
    """`[[group]]`: starters that can be stopped by one command; no other verb works on a group."""

    name: Name = Field(description="Stands where a starter's name stands in command and result topics.")
    title: Title | None = Field(default=None, description="Its name for people; absent: its name.")
    starters: tuple[Glob, ...] = Field(
        strict=False, min_length=1, description="Its members: names, with * and ? as in a shell."
    )


class SimulatedMotorTable(ConfigTable):
    """`[line.starter.simulated.motor]`: the motor behind a simulated starter; keys may be left out."""

    load_pct: float | None = Field(default=None, ge=0, le=1000, description="Share of the rated load.")
    start_current_pct: float | None = Field(
        default=None, ge=100, le=1000, description="Current at the start, of the rated current."
    )
    ramp_up_s: float | None = Field(
        default=None, ge=0.1, le=999, description="Ramp of a start, until the starter is configured."
    )
    ramp_down_s: float | None = Field(default=None, ge=0, le=999, description="Ramp of a stop.")
    friction_pct: float | None = Field(
        default=None, ge=0, le=1000, description="By how much longer the motor accelerates."
    )
    wear_per_start_pct: float | None = Field(
        default=None, ge=0, le=100, description="By so much friction_pct grows with each start."
    )
    wear_per_hour_pct: float | None = Field(
        default=None, ge=0, le=100, description="By so much friction_pct grows with each hour of running."
    )
    thermal_pct: float | None = Field(
        default=None, ge=0, lt=100, description="Thermal image at first, of the level that trips."
    )
    heating_s: float | None = Field(
        default=None, ge=1, le=86400, description="Time constant of the thermal image while current flows."
    )
    cooling_s: float | None = Field(
        default=None, ge=1, le=86400, description="Time constant of the thermal image at standstill."
    )
    undervoltage_pct: float | None = Field(
        default=None, ge=0, le=100, description="Below this share of the rated voltage it trips."
    )
    undervoltage_s: float | None = Field(
        default=None, ge=0.1, le=999, description="After so long an undervoltage it trips."
    )
    phase_loss_s: float | None = Field(
        default=None, ge=0.1, le=999, description="After so long without one phase it trips."
    )
    line_voltage_pct: float = Field(
        default=100.0, ge=0, le=120, description="Voltage of the supply, of the rated voltage."
    )
    lost_phase: Literal["r", "s", "t"] | None = Field(
        default=None, description="The phase of the supply that is missing."
    )


class SimulatedTable(ConfigTable):
    """`[line.starter.simulated]`: what `simulate` makes of a starter; the gateway itself ignores it."""

    firmware: Annotated[str, Field(pattern=FIRMWARE_PATTERN)] | None = Field(
        default=None, description='The firmware that it says it has, e.g. "1.30".'
    )
    parameters: dict[str, Annotated[int, Field(ge=0, le=0xFFFF)]] = Field(
        default={}, description="Words of its parameters by the manual's code, as on the wire."
    )
    markers: dict[str, bool] = Field(
        default={}, description="SSW900: bits of a SoftPLC program, by COIL or DI and the address."
    )
    braking_s: float = Field(
        default=0.0, ge=0, le=600, description="SSW-06, SSW-07: DC braking at each stop; 0: none."
    )
    motor: SimulatedMotorTable = Field(default=SimulatedMotorTable(), description="The motor behind it.")


NOT_SIMULATED = SimulatedTable()  # one for all: nothing changes it


class StarterTable(ConfigTable):
    """`[[line.starter]]`: one machine on a line."""

    name: Name = Field(description="The starter's name: a level in its topics.")
    title: Title | None = Field(
        default=None, description='Its name for people, e.g. "Cooling water 1"; absent: its name.'
    )
    address: int = Field(
        ge=1, le=247, description="Its Modbus address, as set in the starter."
    )  # [SERIAL 2.2]
    family: Family = Field(description="Its family, e.g. ssw07, which also stands for the SSW-08.")
    every_s: float = Field(
        default=1.0,
        ge=0,
        le=3600,
        description="Period of status and electrical values; 0: as fast as the line allows.",
    )
    model: Text | None = Field(
        default=None, description='Its model, e.g. "SSW-06 820A"; absent: as the starter says.'
    )
    slot: int | None = Field(
        default=None, ge=1, le=2, description="SSW900: slot of the RS-485 accessory; absent: as it says."
    )
    response_time_s: float | None = Field(
        default=None, gt=0, le=10, description="Longest time to a reply; absent: as the manual says."
    )
    watchdog_s: float | None = Field(
        default=None,
        ge=0,
        le=1000,
        description="Communication timeout set in the starter, 0: off; what the line cannot keep is refused.",
    )
    enabled: bool = Field(default=True, description='false: never asked, availability "disabled".')
    points: tuple[RowPattern, ...] = Field(
        default=(),
        strict=False,
        description="Rows that are points too, by the manual's codes, with * and ?; read every 10 s.",
    )
    rules: RulesTable | None = Field(default=None, description="Rules of this starter alone.")
    simulated: SimulatedTable = Field(
        default_factory=lambda: NOT_SIMULATED, description="What `simulate` makes of it; `run` ignores it."
    )
    _additions: SiteAdditions = PrivateAttr(default=SiteAdditions())  # of the configuration, to its family

    def profile(self, language: str = ENGLISH) -> Profile:
        """Return its family, with the points and rows that the site adds."""
        return extension.extended(load_profile(self.family, language), *self._additions)

    @property
    def asked(self) -> tuple[extension.SitePoint, ...]:
        """Return the rows that the configuration asks for as points of this starter."""
        return self._additions.points

    def plain(self) -> Self:
        """Return the starter without the points that the configuration adds."""
        copy = self.model_copy()
        copy.add(self._additions._replace(points=()))
        return copy

    def add(self, added: SiteAdditions) -> None:
        """Add to its family what the whole configuration asks for; once, before anybody looks."""
        self._additions = added


class LineTable(ConfigTable):
    """`[[line]]`: one RS-485 line and its starters."""

    name: Name = Field(description="The line's name: a level in the topic of its statistics.")
    title: Title | None = Field(default=None, description="Its name for people; absent: its name.")
    port: Port = Field(description="The adapter: an absolute path, or socket://host:port.")
    baud: Baud = Field(description="Rate, the same in all starters of the line.")
    framing: FramingText = Field(description="Data bits, parity, stop bits; the same in all starters.")
    adapter_allowance_s: float = Field(
        default=0.02, ge=0, le=1, description="What adapter and driver add to the way of a reply."
    )
    deaf_after_s: float = Field(
        default=15.0,
        ge=0,
        le=3600,
        description="After so long a silence of all its starters the port is opened again; 0: never.",
    )
    order: tuple[Name, ...] | None = Field(
        default=None,
        strict=False,
        description="The starters as they follow each other along the cable; absent: by address.",
    )
    points: tuple[RowPattern, ...] = Field(
        default=(), strict=False, description="The same for each starter of the line that has such rows."
    )
    starters: tuple[StarterTable, ...] = Field(
        alias="starter", strict=False, min_length=1, description="The starters on the line, one table each."
    )


class OperatorTable(ConfigTable):
    """`[[operator]]`: what one client may ask of which starters."""

    client: Name = Field(
        description="The level in the command topic; the broker's access list ties it to a login."
    )
    may: tuple[Verb, ...] = Field(
        strict=False, min_length=1, description='Verbs that the client may use; ["*"]: all.'
    )
    starters: tuple[Glob, ...] = Field(
        strict=False, min_length=1, description="Starters and groups: names, with * and ? as in a shell."
    )
    freshness: Literal["token", "issued_at"] = Field(
        default="token",
        description="What proves a command fresh: token or issued_at; issued_at alone, for commands over a "
        "bridge.",
    )


class Config(ConfigTable):
    """A site, whole."""

    gateway: GatewayTable = Field(description="Who this gateway is.")
    mqtt: MqttTable = Field(description="The broker and the way to it.")
    lines: tuple[LineTable, ...] = Field(
        alias="line", strict=False, min_length=1, description="The RS-485 lines, one table each."
    )
    operators: tuple[OperatorTable, ...] = Field(
        default=(), alias="operator", strict=False, description="Who may send commands; none: read-only."
    )
    rules: tuple[SharedRulesTable, ...] = Field(
        default=(), strict=False, description="Rules for several starters; a later table wins."
    )
    groups: tuple[GroupTable, ...] = Field(
        default=(), alias="group", strict=False, description="Starters that one command stops."
    )
    points: tuple[PointsTable, ...] = Field(
        default=(), strict=False, description="Rows of a family that are points too."
    )
    rows: tuple[RowTable, ...] = Field(
        default=(), alias="row", strict=False, description="Rows that the manuals here do not describe."
    )
    web: WebTable | None = Field(default=None, description="The status page; absent: none.")
    metrics: MetricsTable | None = Field(default=None, description="For Prometheus; absent: none.")
    home_assistant: HomeAssistantTable | None = Field(
        default=None, alias="homeassistant", description="Discovery by Home Assistant; absent: none."
    )
    sparkplug: SparkplugTable | None = Field(
        default=None, description="The gateway as a Sparkplug edge node; absent: none."
    )

    @model_validator(mode="after")
    def _extend(self) -> Self:
        """Give each starter what the configuration adds to its family."""
        for line in self.lines:
            for starter in line.starters:
                asked = [(code, DEFAULT_EVERY_S) for code in (*line.points, *starter.points)]
                for table in self.points:
                    is_among = any(fnmatchcase(starter.name, each) for each in table.starters)
                    if table.family == starter.family and is_among:
                        asked += [(code, table.every_s) for code in table.codes]
                starter.add(additions(starter.family, self.rows, asked))
        return self

    @property
    def starters(self) -> tuple[StarterTable, ...]:
        """Return the starters of all lines."""
        return tuple(starter for line in self.lines for starter in line.starters)

    @property
    def base(self) -> str:
        """Return the topics' base with the gateway's name filled in."""
        return self.mqtt.base.replace("{gateway}", self.gateway.name)

    @property
    def client_id(self) -> str:
        """Return the MQTT client id."""
        return self.mqtt.client_id or self.gateway.name


def _repeated(model: type[ConfigTable], path: str = "") -> Iterator[str]:
    for name, field in model.model_fields.items():
        key = f"{path}{field.alias or name}"
        tables = [each for each in get_args(field.annotation) if isinstance(each, type)]
        inner = [each for each in tables if issubclass(each, ConfigTable)]
        if inner and get_origin(field.annotation) is tuple:
            yield key
        for table in inner:
            yield from _repeated(table, f"{key}.")


REPEATED_TABLES = frozenset(_repeated(Config))  # written [[line]], not [line]

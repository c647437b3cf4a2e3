"""The shape of the configuration: frozen models of its tables, from `[gateway]` to `[[operator]]`.

Each table knows what contradicts something else in it. What one value may be is in `values.py`, what
several tables may be together in `cross_checks.py`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, get_args, get_origin

from pydantic import Field, PrivateAttr

from gateway.config.integration_tables import (
    HistoryTable,
    HomeAssistantTable,
    MetricsTable,
    MqttTable,
    SparkplugTable,
    WebTable,
)
from gateway.config.mistakes import WHERE_RIGHT, Mistake, short
from gateway.config.simulated_tables import SimulatedTable
from gateway.config.site_tables import (
    Family,
    Language,
    PointsTable,
    RowTable,
    SiteAdditions,
)
from gateway.config.values import ConfigTable, Glob, Name, Port, RowPattern, Several, Text, Title
from gateway.contract import OWN_VERBS
from gateway.families import ENGLISH, Profile, diagnosis, extension, load_profile

Baud = Literal[1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400]  # what a tty can be set to
FramingText = Literal["8N1", "8N2", "8E1", "8E2", "8O1", "8O2"]
VERBS = ("start", "reset", "set", "jog", "direction", "local_remote", "general_enable", "output", "configure")
if TYPE_CHECKING:
    Verb = str
    TwoStepVerb = str
else:
    Verb = Literal[(*VERBS, "stop", "read", *OWN_VERBS, "*")]
    TwoStepVerb = Literal[VERBS]


class GatewayTable(ConfigTable):
    """`[gateway]`: who this gateway is and where it keeps what must outlive it."""

    name: Name = Field(description="The gateway's name: a level in the topics, and the MQTT client id.")
    state_dir: Path = Field(
        Path("/var/lib/starter-gateway"),
        strict=False,
        description="Folder of what must outlive the gateway: commands, audit, outbox, locks.",
    )
    clock: Literal["auto", "trusted", "untrusted"] = Field(
        "auto",
        description="Whether issued_at proves a command fresh; auto: while the kernel is synchronised.",
    )
    language: Language = Field("en", description="Language of the names; English where a manual has none.")


class RulesTable(ConfigTable):
    """`[line.starter.rules]`: what the gateway demands of commands to one starter; nothing by default."""

    starts_per_hour: int | None = Field(
        None, ge=1, le=1000, description="Most in 60 minutes, local ones too."
    )
    minimum_pause_s: float | None = Field(
        None, ge=0, le=86400, description="Least time at rest before a start."
    )
    feeder: Name | None = Field(None, description="Supply whose starters, of all lines, start one by one.")
    stagger_s: float | None = Field(None, gt=0, le=3600, description="Least time between starts on a feeder.")
    two_step: Several[TwoStepVerb] | None = Field(None, description="Verbs that need a `select`; never stop.")


class SharedRulesTable(RulesTable):
    """`[[rules]]`: the same for several starters; a later table wins, a starter's own over all."""

    starters: Several[Glob] = Field(min_length=1, description="Names of starters, with * and ?.")


class GroupTable(ConfigTable):
    """`[[group]]`: starters that can be stopped by one command; no other verb works on a group."""

    name: Name = Field(description="Stands where a starter's name stands in command and result topics.")
    title: Title | None = Field(None, description="Its name for people; absent: its name.")
    starters: Several[Glob] = Field(min_length=1, description="Its members: names, with * and ?.")


class StarterTable(ConfigTable):
    """`[[line.starter]]`: one machine on a line."""

    name: Name = Field(description="The starter's name: a level in its topics.")
    title: Title | None = Field(None, description="Its name for people; absent: its name.")
    # [SERIAL 2.2]
    address: int = Field(ge=1, le=247, description="Its Modbus address, as set in the starter.")
    family: Family = Field(description="Its family, e.g. ssw07, which also stands for the SSW-08.")
    every_s: float = Field(
        1.0,
        ge=0,
        le=3600,
        description="Period of status and electrical values; 0: as fast as the line allows.",
    )
    model: Text | None = Field(None, description="Its model, e.g. SSW-06 820A; absent: as the starter says.")
    slot: int | None = Field(None, ge=1, le=2, description="SSW900: slot of the RS-485; absent: as it says.")
    response_time_s: float | None = Field(None, gt=0, le=10, description="Longest; absent: the manual's.")
    watchdog_s: float | None = Field(
        None,
        ge=0,
        le=1000,
        description="Timeout set in the starter; 0: off; refused where the line is too slow.",
    )
    enabled: bool = Field(default=True, description='false: never asked, availability "disabled".')
    points: Several[RowPattern] = Field((), description="Rows that are points too, by code, with * and ?.")
    rules: RulesTable | None = Field(None, description="Rules of this starter alone.")
    simulated: SimulatedTable = Field(
        default_factory=cache(SimulatedTable), description="What `simulate` makes of it; `run` ignores it."
    )
    _additions: SiteAdditions = PrivateAttr(SiteAdditions())  # of the configuration, to its family

    def contradictions(self) -> Iterator[Mistake]:
        """Yield what a starter of its family, or a simulated one, does not have."""
        profile = load_profile(self.family)
        if vars(self).get("slot") is not None and len(profile.command_word) < 2:
            yield Mistake(("slot",), f"{self.family} has no slots", "leave it out")
        given = {name: vars(self).get(name) for name in ("model", "watchdog_s")}
        for name, why in diagnosis.wrong_settings(profile, **given):
            yield Mistake((name,), f"{short(given[name])} {why}", "see its manual")
        for mistake in self.simulated.not_of(profile):
            yield replace(mistake, key=("simulated", *mistake.key))

    def profile(self, language: str = ENGLISH) -> Profile:
        """Return its family, with the points and rows that the site adds."""
        return extension.extended(load_profile(self.family, language), *self._additions)

    @property
    def asked(self) -> tuple[extension.SitePoint, ...]:
        """Return the rows that the configuration asks for as points of this starter."""
        return self._additions.points

    def is_among(self, patterns: Iterable[str]) -> bool:
        """Return whether its name fits one of these, with * and ? as in a shell."""
        return any(fnmatchcase(self.name, pattern) for pattern in patterns)

    def plain(self) -> Self:
        """Return the starter without the points that the configuration adds."""
        copy = self.model_copy()
        copy.add(self._additions._replace(points=()))
        return copy

    def add(self, added: SiteAdditions) -> None:
        """Add to its family what the whole configuration asks for."""
        self._additions = added


class LineTable(ConfigTable):
    """`[[line]]`: one RS-485 line and its starters."""

    name: Name = Field(description="The line's name: a level in the topic of its statistics.")
    title: Title | None = Field(None, description="Its name for people; absent: its name.")
    port: Port = Field(description="The adapter: an absolute path, or socket://host:port.")
    baud: Baud = Field(description="Rate, the same in all starters of the line.")
    framing: FramingText = Field(description="Data bits, parity, stop bits; the same in all starters.")
    adapter_allowance_s: float = Field(0.02, ge=0, le=1, description="What the adapter adds to a reply.")
    deaf_after_s: float = Field(
        15.0, ge=0, le=3600, description="The port is reopened after so long a silence of all; 0: never."
    )
    order: Several[Name] | None = Field(None, description="The starters along the cable; absent: by address.")
    points: Several[RowPattern] = Field((), description="The same for each starter that has such rows.")
    starters: Several[StarterTable] = Field(alias="starter", min_length=1, description="Its starters.")

    def contradictions(self) -> Iterator[Mistake]:
        """Yield what is wrong with the order along the cable, and settings that a family does not have."""
        with WHERE_RIGHT:
            names = sorted(each.name for each in self.starters)
            if self.order is not None and sorted(self.order) != names:
                hint = f"name {', '.join(names)} once each, as the cable passes them"
                yield Mistake(("order",), "is not a list of all starters of this line", hint)
        families = {each.family: each for each in self.starters if "family" in vars(each)}
        for key, (family, starter) in product(("baud", "framing"), families.items()):
            value, allowed = vars(self).get(key), getattr(load_profile(family), f"{key}s")
            if value is not None and allowed and value not in allowed:
                hint = f"its manual allows {', '.join(map(str, allowed))}"
                whose = f" ({starter.name})" if "name" in vars(starter) else ""
                yield Mistake((key,), f"{value} is not for {family}{whose}", hint)


class OperatorTable(ConfigTable):
    """`[[operator]]`: what one client may ask of which starters."""

    client: Name = Field(description="The level in the command topic; the broker ties it to a login.")
    may: Several[Verb] = Field(min_length=1, description='Verbs that the client may use; ["*"]: all.')
    starters: Several[Glob] = Field(min_length=1, description="Names, with * and ?; of a group its members.")
    freshness: Literal["token", "issued_at"] = Field(
        "token", description='What proves a command fresh; "token": it or issued_at; "issued_at": that alone.'
    )


class Config(ConfigTable):
    """A site, whole."""

    gateway: GatewayTable = Field(description="Who this gateway is.")
    mqtt: MqttTable = Field(description="The broker and the way to it.")
    lines: Several[LineTable] = Field(alias="line", min_length=1, description="The RS-485 lines.")
    operators: Several[OperatorTable] = Field((), alias="operator", description="Clients that may command.")
    rules: Several[SharedRulesTable] = Field((), description="Rules for several starters; a later one wins.")
    groups: Several[GroupTable] = Field((), alias="group", description="Starters that one command stops.")
    points: Several[PointsTable] = Field((), description="Rows of a family that are points too.")
    rows: Several[RowTable] = Field((), alias="row", description="Rows that the manuals do not describe.")
    web: WebTable | None = Field(None, description="The status page; absent: none.")
    history: HistoryTable | None = Field(None, description="Values over time; absent: not stored.")
    metrics: MetricsTable | None = Field(None, description="For Prometheus; absent: none.")
    home_assistant: HomeAssistantTable | None = Field(
        None, alias="homeassistant", description="Discovery by Home Assistant; absent: none."
    )
    sparkplug: SparkplugTable | None = Field(None, description="A Sparkplug edge node; absent: none.")

    @property
    def traced(self) -> tuple[str, ...]:
        """Return the points whose values are stored over time."""
        return () if self.history is None else self.history.values

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


def _tables(annotation: Any, header: str = "") -> Iterator[tuple[str, list[str], bool]]:
    """Yield a table and all within it: header, keys, and whether there may be several."""
    for model in (annotation, *get_args(annotation)):
        if isinstance(model, type) and issubclass(model, ConfigTable):
            fields = {field.alias or name: field for name, field in model.model_fields.items()}
            yield header, list(fields), get_origin(annotation) is tuple
            for name, field in fields.items():
                yield from _tables(field.annotation, f"{header}.{name}".lstrip("."))


TABLES = {header: keys for header, keys, _ in _tables(Config)}
REPEATED_TABLES = {header for header, _, is_several in _tables(Config) if is_several}  # [[line]], not [line]

"""The tables of the plugins: `[web]`, `[history]`, `[metrics]`, `[homeassistant]`, `[sparkplug]`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.values import (
    PROM_FILE_PATTERN,
    TOPIC_PATTERN,
    URL_PATTERN,
    USER_PATTERN,
    BrokerUrl,
    ConfigTable,
    HostName,
    Listen,
    Name,
    Network,
    PagePath,
    SparkplugId,
    Text,
)
from gateway.system.password_hash import LINE_PATTERN

DEFAULT_DISCOVERY_PREFIX = "homeassistant"


class WebUserTable(ConfigTable):
    """`[[web.user]]`: one login of the status page, with the rights of an operator."""

    name: Annotated[str, Field(pattern=USER_PATTERN, max_length=64)] = Field(description="The login's name.")
    password: Annotated[str, Field(pattern=LINE_PATTERN)] = Field(
        description="What `starter-gateway web-password` prints: the password cannot be read from it."
    )
    operator: Name = Field(
        description="The `client` of an [[operator]]: the same rights, limits and audit as over MQTT."
    )


class WebTable(ConfigTable):
    """`[web]`: the status page; without this table nothing listens."""

    listen: Listen = Field(
        default="127.0.0.1:8480",
        description="address:port or [::1]:port; other addresses than loopback only with logins.",
    )
    hosts: tuple[HostName, ...] = Field(
        default=(), strict=False, description="Further names that the page is called by."
    )
    base_path: PagePath = Field(default="/", description="The path below which a proxy serves the page.")
    cert_file: Text | None = Field(
        default=None, description="The page's certificate, PEM; with key_file it speaks TLS only."
    )
    key_file: Text | None = Field(default=None, description="The page's private key, PEM; with cert_file.")
    allow_plaintext: bool = Field(default=False, description="Permits http:// to other machines.")
    trusted_proxies: tuple[Network, ...] = Field(
        default=(), strict=False, description='Addresses or networks of proxies, e.g. "::1".'
    )
    pages_per_address: int = Field(
        default=32, ge=1, le=48, description="How many pages may be open at one address, or by one login."
    )
    users: tuple[WebUserTable, ...] = Field(
        default=(), alias="user", strict=False, description="Who may log in; none: the page is read-only."
    )


class HistoryTable(ConfigTable):
    """`[history]`: stores values over time for seven days; starts and trips are recorded without it."""

    values: tuple[Name, ...] = Field(
        default=("current",),
        strict=False,
        min_length=1,
        max_length=8,
        description="The points, of every starter that has them.",
    )


class MetricsTable(ConfigTable):
    """`[metrics]`: what Prometheus scrapes, on the status page's server or in a file."""

    all_points: bool = Field(
        default=False, description="Adds every point that is a number, as point_value; many series."
    )
    token_file: Text | None = Field(
        default=None,
        description="File with the token that a scrape must carry, for its owner only; or a systemd "
        "credential, metrics.token; without: none is needed from this machine, or by TLS.",
    )
    textfile: Annotated[str, Field(pattern=PROM_FILE_PATTERN, max_length=1024)] | None = Field(
        default=None, description="File for node-exporter's textfile collector, written every 15 s."
    )


class HomeAssistantTable(ConfigTable):
    """`[homeassistant]`: announces the starters to Home Assistant; without this table nothing is."""

    discovery_prefix: Annotated[str, Field(pattern=TOPIC_PATTERN, max_length=128)] = Field(
        default=DEFAULT_DISCOVERY_PREFIX, description="Home Assistant's discovery prefix, as set there."
    )
    birth_topic: Annotated[str, Field(pattern=TOPIC_PATTERN, max_length=128)] | None = Field(
        default=None,
        description='Where Home Assistant publishes "online" when it has begun; absent: PREFIX/status.',
    )
    operator: Name | None = Field(
        default=None,
        description="Home Assistant's login at the broker, the `client` of an [[operator]]; its rights "
        "decide which buttons there are. Absent: none.",
    )
    commands: bool = Field(
        default=False, description="Buttons for start and reset too; a stop needs an operator only."
    )
    page_url: Annotated[str, Field(pattern=URL_PATTERN, max_length=256)] | None = Field(
        default=None, description="The status page as others reach it; shown at each device."
    )


class SparkplugTable(ConfigTable):
    """`[sparkplug]`: the gateway as a Sparkplug B 3.0 edge node; without this table it is none."""

    group: SparkplugId = Field(description="The group id: the first level that hosts sort nodes by.")
    node: SparkplugId | None = Field(
        default=None, description="The edge node id, unique in its group; absent: the gateway's name."
    )
    urls: tuple[BrokerUrl, ...] = Field(
        default=(),
        strict=False,
        description="Servers of its own, tried one after the other; absent: the broker, login and "
        "certificates of [mqtt].",
    )
    username: Text | None = Field(default=None, description="Login at the servers in urls; absent: none.")
    password_file: Text | None = Field(
        default=None,
        description="File with that login's password in one line, for its owner only; or a systemd "
        "credential, sparkplug.password.",
    )
    ca_file: Text | None = Field(
        default=None, description="The certificate authority of the servers in urls; absent: the system's."
    )
    cert_file: Text | None = Field(default=None, description="The client's certificate, PEM; with key_file.")
    key_file: Text | None = Field(default=None, description="The client's private key, PEM; with cert_file.")
    allow_plaintext: bool = Field(
        default=False, description="Permits mqtt:// in urls to servers on other machines."
    )
    mqtt_version: Literal["auto", "5", "3.1.1"] = Field(
        default="auto", description="The version of MQTT; auto: 5, and 3.1.1 where a server refuses that."
    )
    keepalive_s: int = Field(
        default=15, ge=5, le=3600, description="Without traffic for so long the server is pinged."
    )
    primary_host: SparkplugId | None = Field(
        default=None,
        description="Host id of the application that must be online before anything is published.",
    )
    commands: bool = Field(
        default=False, description="Whether hosts may write Command/Stop, Command/Start and Command/Reset."
    )
    operator: Name | None = Field(
        default=None,
        description="The `client` of an [[operator]]: whose rights all Sparkplug hosts together have.",
    )
    ttl_s: float = Field(
        default=5.0, gt=0, le=60, description="How old a command may be, by its payload's timestamp."
    )
    datatypes_in_data: bool = Field(
        default=False,
        description="Names data types in data messages too, for hosts that do not remember births.",
    )

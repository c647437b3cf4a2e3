"""The tables of the networks and of the history: `[mqtt]`, `[web]`, `[history]`, `[metrics]` and others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import Field

from gateway.config.mistakes import WHERE_RIGHT, Mistake
from gateway.config.values import (
    SCHEMES,
    Base,
    BrokerUrl,
    ConfigTable,
    HostName,
    Listen,
    Name,
    Network,
    PagePath,
    PromFile,
    Several,
    SparkplugId,
    Text,
    Topic,
    Url,
    User,
    is_loopback,
    split_listen,
)
from gateway.system.password_hash import LINE_PATTERN

DEFAULT_BASE = "starters/{gateway}"
_OWN_SERVERS = "without urls those of [mqtt] count"
_UNENCRYPTED = "would send passwords and commands unencrypted"

MqttVersion = Literal["auto", "5", "3.1.1"]


class LoginTable(ConfigTable):
    """How the gateway proves itself to a broker, and the broker to the gateway."""

    username: Text | None = Field(None, description="Login at the broker; absent: none.")
    password_file: Text | None = Field(
        None, description="Its owner's alone, one line; or a credential, or STARTER_GATEWAY_MQTT_PASSWORD."
    )
    ca_file: Text | None = Field(None, description="The broker's authority, PEM; absent: the system's.")
    cert_file: Text | None = Field(None, description="The client's certificate, PEM; with key_file.")
    key_file: Text | None = Field(None, description="The client's private key, PEM; with cert_file.")
    allow_plaintext: bool = Field(default=False, description="Permits mqtt:// to brokers on other machines.")

    def is_exposed(self, url: str) -> bool:
        """Return whether a broker on another machine is reached without encryption, and may not be."""
        split = urlsplit(url)
        return split.scheme == "mqtt" and not is_loopback(split.hostname or "") and not self.allow_plaintext


class MqttTable(LoginTable):
    """`[mqtt]`: the broker and the way to it; file names are relative to the configuration's folder."""

    url: BrokerUrl = Field(description="The broker: mqtt://host[:1883], or mqtts://host[:8883] with TLS.")
    base: Base = Field(DEFAULT_BASE, description="What topics begin with; {gateway} is the gateway's name.")
    client_id: Text | None = Field(None, description="The MQTT client id; absent: the gateway's name.")
    version: MqttVersion = Field("auto", description="The version of MQTT; auto: 5, else 3.1.1.")
    keepalive_s: int = Field(
        6, ge=3, le=3600, description="After 1.5 times so long a silence the broker publishes offline."
    )
    refresh_s: float = Field(300.0, ge=1, le=86400, description="When unchanged values are published again.")

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

    def contradictions(self) -> Iterator[Mistake]:
        """Yield an open way to another machine, and files of TLS without TLS."""
        yield from super().contradictions()
        for name in ("ca_file", "cert_file", "key_file"):
            if vars(self).get(name) and not self.is_tls:
                yield Mistake((name,), "has no meaning with mqtt://", "use mqtts://, or leave it out")
        if self.is_exposed(self.url):
            yield Mistake(("url",), _UNENCRYPTED, "use mqtts://, or allow_plaintext = true")


class WebUserTable(ConfigTable):
    """`[[web.user]]`: one login of the status page, with the rights of an operator."""

    name: User = Field(description="The login's name.")
    password: Annotated[str, Field(pattern=LINE_PATTERN)] = Field(
        description="What `starter-gateway web-password` prints: the password cannot be read from it."
    )
    operator: Name = Field(description="The `client` of an [[operator]]: the login has its rights.")


class WebTable(ConfigTable):
    """`[web]`: the status page; without this table nothing listens."""

    listen: Listen = Field(
        "127.0.0.1:8480", description="address:port; other than loopback only with logins."
    )
    hosts: Several[HostName] = Field((), description="Further names that the page is called by.")
    base_path: PagePath = Field("/", description="The path below which a proxy serves the page.")
    cert_file: Text | None = Field(None, description="The page's certificate, PEM; with it TLS only.")
    key_file: Text | None = Field(None, description="The page's private key, PEM; with cert_file.")
    allow_plaintext: bool = Field(default=False, description="Permits http:// to other machines.")
    trusted_proxies: Several[Network] = Field((), description='Addresses or networks of proxies, e.g. "::1".')
    pages_per_address: int = Field(32, ge=1, le=48, description="Most pages open at one address or login.")
    users: Several[WebUserTable] = Field((), alias="user", description="Who may log in; none: read-only.")

    def contradictions(self) -> Iterator[Mistake]:
        """Yield what would open the page to more than this machine without protection."""
        yield from super().contradictions()
        host, _ = split_listen(self.listen) or ("", 0)
        if is_loopback(host):
            return
        with WHERE_RIGHT:
            if self.cert_file is None and not self.allow_plaintext:
                hint = "give cert_file and key_file, or allow_plaintext = true, or listen on 127.0.0.1"
                yield Mistake(("listen",), _UNENCRYPTED, hint)
        if not self.users:
            hint = "add a [[web.user]], or listen on 127.0.0.1"
            yield Mistake(("listen",), "opens the page to other machines without any login", hint)


class HistoryTable(ConfigTable):
    """`[history]`: stores values over time for seven days; starts and trips are recorded without it."""

    values: Several[Name] = Field(("current",), min_length=1, max_length=8, description="Names of points.")


class MetricsTable(ConfigTable):
    """`[metrics]`: what Prometheus scrapes, on the status page's server or in a file."""

    all_points: bool = Field(default=False, description="Adds every point that is a number, as point_value.")
    token_file: Text | None = Field(
        None, description="File with a scrape's token, its owner's alone; or the credential metrics.token."
    )
    textfile: PromFile | None = Field(None, description="File for node-exporter, written every 15 s.")


class HomeAssistantTable(ConfigTable):
    """`[homeassistant]`: announces the starters to Home Assistant; without this table nothing is."""

    discovery_prefix: Topic = Field("homeassistant", description="The discovery prefix set there.")
    birth_topic: Topic | None = Field(None, description='Where it publishes "online"; absent: PREFIX/status.')
    operator: Name | None = Field(
        None, description="Its login at the broker, the `client` of an [[operator]], whose rights it has."
    )
    commands: bool = Field(default=False, description="Buttons for start and reset too, beside stop.")
    page_url: Url | None = Field(None, description="The page as others reach it; shown at each device.")


class SparkplugTable(LoginTable):
    """`[sparkplug]`: the gateway as a Sparkplug B 3.0 edge node; without this table it is none."""

    NEEDS = (*ConfigTable.NEEDS, *((name, "urls", _OWN_SERVERS) for name in LoginTable.model_fields))

    group: SparkplugId = Field(description="The group id: the first level that hosts sort nodes by.")
    node: SparkplugId | None = Field(None, description="The edge node id; absent: the gateway's name.")
    urls: Several[BrokerUrl] = Field(
        (), description="Servers of its own, in this order, with this table's login; absent: that of [mqtt]."
    )
    mqtt_version: MqttVersion = Field("auto", description="The version of MQTT; auto: 5, else 3.1.1.")
    keepalive_s: int = Field(15, ge=5, le=3600, description="After so long without traffic a ping is sent.")
    primary_host: SparkplugId | None = Field(None, description="Host without which nothing is published.")
    commands: bool = Field(
        default=False, description="Whether hosts may write Command/Stop, Start and Reset."
    )
    operator: Name | None = Field(None, description="The `client` of an [[operator]], for all hosts.")
    ttl_s: float = Field(5.0, gt=0, le=60, description="How old a command may be, by its timestamp.")
    datatypes_in_data: bool = Field(default=False, description="Names data types in data messages too.")

    def contradictions(self) -> Iterator[Mistake]:
        """Yield servers without encryption, and what is for servers of its own only."""
        yield from super().contradictions()
        for place, url in enumerate(self.urls):
            if self.is_exposed(url):
                yield Mistake(("urls", place), _UNENCRYPTED, "use mqtts://, or allow_plaintext = true")

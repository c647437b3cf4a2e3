"""Rules of what goes over a network: the broker, the page, the integrations."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.config.integration_tables import (
    DEFAULT_DISCOVERY_PREFIX,
    HomeAssistantTable,
    MetricsTable,
    SparkplugTable,
    WebTable,
    WebUserTable,
)
from gateway.config.mistakes import Document, Mistake, Tables, again, choose, texts_in
from gateway.config.schema import DEFAULT_BASE, MqttTable
from gateway.config.toml_lines import Key
from gateway.config.values import is_loopback, short, split_listen, split_url

SPARKPLUG_NAMESPACE = "spBv1.0"
_OWN_SERVERS = ("username", "password_file", "ca_file", "cert_file", "key_file", "allow_plaintext")
_CERTIFICATE = "a certificate and its key go together"
_TOGETHER = (  # a key, what it needs beside it, and why
    ("cert_file", "key_file", _CERTIFICATE),
    ("key_file", "cert_file", _CERTIFICATE),
    ("password_file", "username", "a password belongs to a user"),
)


def network_mistakes(document: Document, tables: Tables) -> Iterator[Mistake]:
    """Yield every mistake in what goes over a network that no single value shows."""
    clients = texts_in(document, "operator", "client")
    for key, table in tables.items():
        for one, other, hint in _TOGETHER:
            if one in table.model_fields_set and other not in table.model_fields_set:
                yield Mistake((*key, one), f"needs {other} beside it", hint)
        if isinstance(table, WebUserTable | HomeAssistantTable | SparkplugTable):
            yield from _operator(key, table, clients)
        match table:
            case MqttTable():
                yield from _broker(table)
            case WebTable():
                yield from _web(table)
            case HomeAssistantTable():
                base = next(iter(texts_in(document, "mqtt", "base")), DEFAULT_BASE)
                name = "".join(texts_in(document, "gateway", "name"))
                yield from _home_assistant(table, base.replace("{gateway}", name))
            case SparkplugTable():
                yield from _sparkplug(table)
            case MetricsTable() if "web" not in document and table.textfile is None:
                hint = "add a [web] table, whose server answers /metrics, or a textfile for node-exporter"
                yield Mistake(key, "nothing serves them", hint)


def _broker(mqtt: MqttTable) -> Iterator[Mistake]:
    yield from _open(("mqtt", "url"), mqtt.url, may_be_open=mqtt.allow_plaintext)
    for name in ("ca_file", "cert_file", "key_file"):
        if name in mqtt.model_fields_set and not mqtt.is_tls:
            yield Mistake(("mqtt", name), "has no meaning with mqtt://", "use mqtts://, or leave it out")


def _open(key: Key, url: str, *, may_be_open: bool) -> Iterator[Mistake]:
    """Yield a broker on another machine without encryption, unless that may be."""
    parts = split_url(url)
    is_open = parts is not None and parts[0].scheme == "mqtt" and not is_loopback(parts[0].hostname or "")
    if is_open and not may_be_open:
        hint = "use mqtts://, or allow_plaintext = true"
        yield Mistake(key, "would send passwords and commands unencrypted", hint)


def _web(web: WebTable) -> Iterator[Mistake]:
    """Yield what would open the page to more than this machine without protection, and logins named twice."""
    seen: dict[object, Key] = {}
    for index, user in enumerate(web.users):
        yield from again(seen, ("web", "user", index, "name"), user.name, "each login needs its own name")
    endpoint = split_listen(web.listen)
    if endpoint is None or is_loopback(endpoint[0]):
        return
    if web.cert_file is None and not web.allow_plaintext:
        hint = "give cert_file and key_file, or allow_plaintext = true, or listen on 127.0.0.1"
        yield Mistake(("web", "listen"), "would send passwords and commands unencrypted", hint)
    if not web.users:
        hint = "add a [[web.user]], or listen on 127.0.0.1"
        yield Mistake(("web", "listen"), "opens the page to other machines without any login", hint)


def _operator(
    key: Key, table: WebUserTable | HomeAssistantTable | SparkplugTable, clients: list[str]
) -> Iterator[Mistake]:
    """Yield a name that should be an operator's client and is not, and commands without one."""
    client = table.operator
    if client is not None and client not in clients:
        hint = choose(client, clients) if clients else "add an [[operator]] with this client"
        yield Mistake((*key, "operator"), f"{short(client)} is no [[operator]]'s client", hint)
    if client is None and not isinstance(table, WebUserTable) and table.commands:
        hint = "name the [[operator]] whose rights these commands have"
        yield Mistake((*key, "commands"), "needs operator beside it", hint)


def _home_assistant(table: HomeAssistantTable, base: str) -> Iterator[Mistake]:
    """Yield topics that are the gateway's own, Sparkplug's or discovery's."""
    prefix = table.discovery_prefix
    if "discovery_prefix" not in table.model_fields_set and _is_one_in_the_other(base, prefix):
        hint = f"another base, or discovery_prefix, which is {short(DEFAULT_DISCOVERY_PREFIX)} by itself"
        yield Mistake(("mqtt", "base"), "lies among the topics of Home Assistant's discovery", hint)
    for key in table.model_fields_set & {"discovery_prefix", "birth_topic"}:
        topic, where = getattr(table, key), ("homeassistant", key)
        for others, whose in ((base, "the gateway's own"), (SPARKPLUG_NAMESPACE, "Sparkplug's")):
            if _is_one_in_the_other(topic, others):
                yield Mistake(where, f"lies among {whose} topics", f"a topic outside {short(others)}")
    devices = f"{prefix}/device"
    if _is_one_in_the_other(table.birth_topic or "", devices):
        hint = f"a topic outside {short(devices)}, such as {prefix}/status"
        yield Mistake(("homeassistant", "birth_topic"), "lies among the topics of discovery", hint)


def _is_one_in_the_other(one: str, other: str) -> bool:
    """Return whether a topic is the other one, or one of its levels; False when there is none."""
    one, other = f"{one}/", f"{other}/"
    return one != "/" and (one.startswith(other) or other.startswith(one))


def _sparkplug(table: SparkplugTable) -> Iterator[Mistake]:
    """Yield servers without encryption, and what is for servers of its own only."""
    for place, url in enumerate(table.urls):
        yield from _open(("sparkplug", "urls", place), url, may_be_open=table.allow_plaintext)
    for name in _OWN_SERVERS:
        if name in table.model_fields_set and not table.urls:
            yield Mistake(("sparkplug", name), "needs urls beside it", "without urls those of [mqtt] count")

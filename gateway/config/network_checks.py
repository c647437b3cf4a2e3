"""Rules across the tables of what goes over a network: the broker, the page, the integrations."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterator, Mapping

from gateway.config.integration_tables import DEFAULT_DISCOVERY_PREFIX
from gateway.config.mistakes import Document, Mistake, again, choose, list_in, short, table_in, text_in
from gateway.config.schema import DEFAULT_BASE
from gateway.config.toml_lines import Key
from gateway.config.values import NAME_PATTERN, SCHEMES, is_loopback, split_listen, split_url

SPARKPLUG_NAMESPACE = "spBv1.0"
_NAME = re.compile(NAME_PATTERN[1:-1])
_OWN_SERVERS = ("username", "password_file", "ca_file", "cert_file", "key_file", "allow_plaintext")
_CERTIFICATE = "a certificate and its key go together"
_TOGETHER = (  # a key, what it needs beside it, and why
    ("cert_file", "key_file", _CERTIFICATE),
    ("key_file", "cert_file", _CERTIFICATE),
    ("password_file", "username", "a password belongs to a user"),
)


def network_mistakes(document: Document) -> Iterator[Mistake]:
    """Yield every mistake in what goes over a network that no single value shows."""
    yield from _broker(document)
    yield from _base(document)
    yield from _web(document)
    yield from _web_users(document)
    yield from _metrics(document)
    yield from _home_assistant(document)
    yield from _sparkplug(document)


def _broker(document: Document) -> Iterator[Mistake]:
    mqtt = table_in(document, "mqtt")
    url = text_in(mqtt, "url")
    yield from _url(("mqtt", "url"), url, is_open=mqtt.get("allow_plaintext") is True)
    parts = split_url(url)
    if parts is not None and parts[0].scheme == "mqtt":
        for name in ("ca_file", "cert_file", "key_file"):
            if name in mqtt:
                yield Mistake(("mqtt", name), "has no meaning with mqtt://", "use mqtts://, or leave it out")
    yield from _apart(document, "mqtt")


def _apart(document: Document, name: str) -> Iterator[Mistake]:
    """Yield keys of a table that lack what they need beside them."""
    table = table_in(document, name)
    for one, other, hint in _TOGETHER:
        if one in table and other not in table:
            yield Mistake((name, one), f"needs {other} beside it", hint)


def _url(key: Key, url: str, *, is_open: bool) -> Iterator[Mistake]:
    """Yield what is wrong with a broker's address; `is_open`: it may be unencrypted."""
    if not url:
        return
    parts = split_url(url)
    if parts is None:
        scheme = url.partition("://")[0]
        hint = choose(scheme, SCHEMES) if "://" in url and scheme not in SCHEMES else "mqtts://host:8883"
        without_login = re.sub(r"[^/]*@", "...@", url)
        yield Mistake(key, f"{short(without_login)} is no broker address", hint)
        return
    split, _port = parts
    if split.username is not None or split.password is not None:
        yield Mistake(key, "holds a login", "use username and password_file")
    if split.path not in ("", "/") or split.query or split.fragment:
        yield Mistake(key, "has more than a host and a port", "leave out what follows the port")
    is_local = is_loopback(split.hostname or "")
    if split.scheme == "mqtt" and not is_local and not is_open:
        hint = "use mqtts://, or allow_plaintext = true"
        yield Mistake(key, "would send passwords and commands unencrypted", hint)


def _base(document: Document) -> Iterator[Mistake]:
    base = text_in(table_in(document, "mqtt"), "base")
    if not base:
        return
    for level in base.replace("{gateway}", "x").split("/"):
        if not _NAME.fullmatch(level):
            what = f"has the level {short(level)}" if level else "has an empty level"
            yield Mistake(("mqtt", "base"), what, "only a-z, 0-9, _ and - between slashes, and {gateway}")


def _web(document: Document) -> Iterator[Mistake]:
    """Yield what would open the page to more than this machine without protection."""
    web = table_in(document, "web")
    listen = text_in(web, "listen")
    yield from _apart(document, "web")
    for place, proxy in enumerate(list_in(web, "trusted_proxies")):
        if isinstance(proxy, str) and not _is_network(proxy):
            hint = "an address or network such as 192.0.2.7 or 10.0.0.0/8"
            yield Mistake(("web", "trusted_proxies", place), f"{short(proxy)} is no address", hint)
    if not {".", ".."}.isdisjoint(text_in(web, "base_path").split("/")):
        hint = "a path such as /mcc1: browsers resolve . and .. before they ask"
        yield Mistake(("web", "base_path"), f"{short(web['base_path'])} has a level . or ..", hint)
    if not listen:
        return
    endpoint = split_listen(listen)
    if endpoint is None:
        hint = "address:port, such as 127.0.0.1:8480 or [::1]:8480; 0.0.0.0 for all addresses"
        yield Mistake(("web", "listen"), f"{short(listen)} is no address with a port", hint)
        return
    if is_loopback(endpoint[0]):
        return
    if "cert_file" not in web and web.get("allow_plaintext") is not True:
        hint = "give cert_file and key_file, or allow_plaintext = true, or listen on 127.0.0.1"
        yield Mistake(("web", "listen"), "would send passwords and commands unencrypted", hint)
    if not list_in(web, "user"):
        hint = "add a [[web.user]], or listen on 127.0.0.1"
        yield Mistake(("web", "listen"), "opens the page to other machines without any login", hint)


def _web_users(document: Document) -> Iterator[Mistake]:
    seen: dict[object, Key] = {}
    for index, user in enumerate(list_in(table_in(document, "web"), "user")):
        if not isinstance(user, Mapping):
            continue
        key: Key = ("web", "user", index)
        yield from again(seen, (*key, "name"), text_in(user, "name"), "each login needs its own name")
        yield from _operator(document, (*key, "operator"), text_in(user, "operator"))


def _operator(document: Document, key: Key, client: str) -> Iterator[Mistake]:
    """Yield a name that should be an operator's client and is not."""
    tables = list_in(document, "operator")
    operators = [text_in(table, "client") for table in tables if isinstance(table, Mapping)]
    if client and client not in operators:
        hint = choose(client, operators) if operators else "add an [[operator]] with this client"
        yield Mistake(key, f"{short(client)} is no [[operator]]'s client", hint)


def _home_assistant(document: Document) -> Iterator[Mistake]:
    """Yield buttons that no operator has, and topics that are the gateway's own."""
    table = table_in(document, "homeassistant")
    yield from _operator(document, ("homeassistant", "operator"), text_in(table, "operator"))
    if table.get("commands") is True and not text_in(table, "operator"):
        hint = "name the [[operator]] whose rights Home Assistant has"
        yield Mistake(("homeassistant", "commands"), "needs operator beside it", hint)
    if "homeassistant" not in document:
        return
    base = text_in(table_in(document, "mqtt"), "base") or DEFAULT_BASE
    base = base.replace("{gateway}", text_in(table_in(document, "gateway"), "name"))
    prefix = text_in(table, "discovery_prefix") or DEFAULT_DISCOVERY_PREFIX
    if "discovery_prefix" not in table and _is_one_in_the_other(base, prefix):
        hint = f"another base, or discovery_prefix, which is {short(prefix)} when it is left out"
        yield Mistake(("mqtt", "base"), "lies among the topics of Home Assistant's discovery", hint)
    for key in ("discovery_prefix", "birth_topic"):
        topic, where = text_in(table, key), ("homeassistant", key)
        if not topic:
            continue
        if _is_one_in_the_other(topic, base):
            hint = f"a topic outside {short(base)}"
            yield Mistake(where, "lies among the gateway's own topics", hint)
        if _is_one_in_the_other(topic, SPARKPLUG_NAMESPACE):
            hint = f"a topic outside {SPARKPLUG_NAMESPACE}, which is Sparkplug's alone"
            yield Mistake(where, "lies among Sparkplug's topics", hint)
    devices = f"{prefix}/device"
    if _is_one_in_the_other(text_in(table, "birth_topic"), devices):
        hint = f"a topic outside {short(devices)}, such as {prefix}/status"
        yield Mistake(("homeassistant", "birth_topic"), "lies among the topics of discovery", hint)


def _is_one_in_the_other(one: str, other: str) -> bool:
    """Return whether a topic is the other one, or one of its levels; False when there is none."""
    one, other = f"{one}/", f"{other}/"
    return one != "/" and (one.startswith(other) or other.startswith(one))


def _metrics(document: Document) -> Iterator[Mistake]:
    """Yield metrics that no one can read."""
    metrics = document.get("metrics")
    if isinstance(metrics, Mapping) and "web" not in document and "textfile" not in metrics:
        hint = "add a [web] table, whose server answers /metrics, or a textfile for node-exporter"
        yield Mistake(("metrics",), "nothing serves them", hint)


def _sparkplug(document: Document) -> Iterator[Mistake]:
    """Yield wrong servers, what is for servers of its own only, and commands without an operator."""
    table = table_in(document, "sparkplug")
    urls = list_in(table, "urls")
    for place, url in enumerate(urls):
        if isinstance(url, str):
            is_open = table.get("allow_plaintext") is True
            yield from _url(("sparkplug", "urls", place), url, is_open=is_open)
    for name in _OWN_SERVERS:
        if name in table and not urls:
            yield Mistake(("sparkplug", name), "needs urls beside it", "without urls those of [mqtt] count")
    yield from _apart(document, "sparkplug")
    yield from _operator(document, ("sparkplug", "operator"), text_in(table, "operator"))
    if table.get("commands") is True and "operator" not in table:
        hint = "name the [[operator]] whose rights Sparkplug's hosts have"
        yield Mistake(("sparkplug", "commands"), "needs operator beside it", hint)


def _is_network(text: str) -> bool:
    try:
        ipaddress.ip_network(text, strict=False)
    except ValueError:
        return False
    return True

"""What the configuration's values must be together.

The rules look at the document as parsed, before the models: a mistake in one table must not hide those in
others. A value of the wrong type is the models' business and passes here.
"""

from __future__ import annotations

import fnmatch
import posixpath
import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from gateway.config.mistakes import Mistake, choose, short, spell
from gateway.config.schema import NAME_PATTERN, SCHEMES, Baud, FramingText, is_loopback, split_url
from gateway.config.toml_lines import Key
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Profile

Document = Mapping[str, Any]

_NAME = re.compile(NAME_PATTERN[1:-1])
_SOCKET = re.compile(r"socket://[^\s:/]+:(\d{1,5})")


def broken_rules(document: Document) -> list[Mistake]:
    """Return every mistake that no single value shows."""
    return [
        *_broker(document),
        *_tls(document),
        *_base(document),
        *_ports(document),
        *_duplicates(document),
        *_families(document),
        *_patterns(document),
        *_groups(document),
        *_feeders(document),
        *_simulated(document),
    ]


def _broker(document: Document) -> Iterator[Mistake]:
    mqtt = _table(document, "mqtt")
    url = _text(mqtt, "url")
    if not url:
        return
    key = ("mqtt", "url")
    parts = split_url(url)
    if parts is None:
        scheme = url.partition("://")[0]
        mend = choose(scheme, SCHEMES) if "://" in url and scheme not in SCHEMES else "mqtts://host:8883"
        yield Mistake(key, f"{short(_without_login(url))} is no broker address", mend)
        return
    split, _port = parts
    if split.username is not None or split.password is not None:
        yield Mistake(key, "holds a login", "use username and password_file")
    if split.path not in ("", "/") or split.query or split.fragment:
        yield Mistake(key, "has more than a host and a port", "leave out what follows the port")
    is_local = is_loopback(split.hostname or "")
    if split.scheme == "mqtt" and not is_local and mqtt.get("allow_plaintext") is not True:
        mend = "use mqtts://, or allow_plaintext = true"
        yield Mistake(key, "would send passwords and commands unencrypted", mend)


def _without_login(url: str) -> str:
    return re.sub(r"[^/]*@", "...@", url)


def _tls(document: Document) -> Iterator[Mistake]:
    mqtt = _table(document, "mqtt")
    parts = split_url(_text(mqtt, "url"))
    if parts is not None and parts[0].scheme == "mqtt":
        for name in ("ca_file", "cert_file", "key_file"):
            if name in mqtt:
                yield Mistake(("mqtt", name), "has no meaning with mqtt://", "use mqtts://, or leave it out")
    for one, other in (("cert_file", "key_file"), ("key_file", "cert_file")):
        if one in mqtt and other not in mqtt:
            yield Mistake(("mqtt", one), f"needs {other} beside it", "a certificate and its key go together")
    if "password_file" in mqtt and "username" not in mqtt:
        yield Mistake(("mqtt", "password_file"), "needs username beside it", "a password belongs to a user")


def _base(document: Document) -> Iterator[Mistake]:
    base = _text(_table(document, "mqtt"), "base")
    if not base:
        return
    for level in base.replace("{gateway}", "x").split("/"):
        if not _NAME.fullmatch(level):
            what = f"has the level {short(level)}" if level else "has an empty level"
            yield Mistake(("mqtt", "base"), what, "only a-z, 0-9, _ and - between slashes, and {gateway}")


def _ports(document: Document) -> Iterator[Mistake]:
    for key, line in _lines(document):
        port = _text(line, "port")
        if not port or posixpath.isabs(port):
            continue
        socket = _SOCKET.fullmatch(port)
        if socket is None or not 0 < int(socket[1]) <= 0xFFFF:
            mend = "an absolute path such as /dev/serial/by-id/..., or socket://host:port"
            yield Mistake((*key, "port"), f"{short(port)} is no port", mend)


def _duplicates(document: Document) -> Iterator[Mistake]:
    lines: dict[object, Key] = {}
    ports: dict[object, Key] = {}
    starters: dict[object, Key] = {}
    for key, line in _lines(document):
        addresses: dict[object, Key] = {}
        yield from _again(lines, (*key, "name"), _text(line, "name"), "each line needs its own name")
        yield from _again(ports, (*key, "port"), _port(line), "put all starters of a port under one [[line]]")
        for starter_key, starter in _starters(key, line):
            mend = "each starter needs its own name, whatever its line"
            yield from _again(starters, (*starter_key, "name"), _text(starter, "name"), mend)
            mend = "each starter on a line needs its own address"
            yield from _again(addresses, (*starter_key, "address"), starter.get("address"), mend)


def _port(line: Document) -> str:
    port = _text(line, "port")
    return posixpath.normpath(port) if posixpath.isabs(port) else port


def _again(seen: dict[object, Key], key: Key, value: object, mend: str) -> Iterator[Mistake]:
    if not value or not isinstance(value, str | int):
        return
    if value in seen:
        yield Mistake(key, f"{short(value)} is also {spell(seen[value])}", mend)
    seen.setdefault(value, key)


def _families(document: Document) -> Iterator[Mistake]:
    for key, line in _lines(document):
        by_family = {s["family"]: _text(s, "name") for _, s in _starters(key, line) if _is_family(s)}
        for family, name in by_family.items():
            yield from _serial(key, line, load_profile(family), name)
        for starter_key, starter in _starters(key, line):
            if "slot" in starter and _is_family(starter):
                yield from _slot(starter_key, load_profile(starter["family"]))
            if starter.get("fast_words") is True and _is_family(starter):
                yield from _fast_words(starter_key, load_profile(starter["family"]))


def _is_family(starter: Document) -> bool:
    return _text(starter, "family") in FAMILIES


def _serial(key: Key, line: Document, profile: Profile, name: str) -> Iterator[Mistake]:
    """Tell what a family's serial interface cannot be set to; `name` is a starter of it on this line."""
    baud, framing = line.get("baud"), line.get("framing")
    if baud in get_args(Baud) and profile.bauds and baud not in profile.bauds:
        mend = f"its manual allows {', '.join(map(str, profile.bauds))}"
        yield Mistake((*key, "baud"), f"{baud} is not for {profile.family} ({name})", mend)
    if framing in get_args(FramingText) and framing not in profile.framings:
        mend = f"its manual allows {', '.join(profile.framings)}"
        what = f"{short(framing)} is not for {profile.family} ({name})"
        yield Mistake((*key, "framing"), what, mend)


def _slot(key: Key, profile: Profile) -> Iterator[Mistake]:
    if len(profile.command_word) < 2:
        yield Mistake((*key, "slot"), f"{profile.family} has no slots", "leave it out")


def _fast_words(key: Key, profile: Profile) -> Iterator[Mistake]:
    if profile.fast_words is None:
        yield Mistake((*key, "fast_words"), f"{profile.family} has no words to map", "leave it out")


def _patterns(document: Document) -> Iterator[Mistake]:
    starters = [starter for key, line in _lines(document) for _, starter in _starters(key, line)]
    names = [_text(starter, "name") for starter in starters if _text(starter, "name")]
    for where in ("operator", "rules", "group"):
        for index, table in enumerate(_list(document, where)):
            patterns = _list(table, "starters") if isinstance(table, Mapping) else []
            for position, pattern in enumerate(patterns):
                if isinstance(pattern, str) and not fnmatch.filter(names, pattern):
                    mend = choose(pattern, names) if names else ""
                    key = (where, index, "starters", position)
                    yield Mistake(key, f"{short(pattern)} fits no starter", mend)


def _groups(document: Document) -> Iterator[Mistake]:
    """Tell groups whose name is taken: a command's topic must say which is meant."""
    seen: dict[object, Key] = {}
    for key, line in _lines(document):
        for starter_key, starter in _starters(key, line):
            seen.setdefault(_text(starter, "name"), (*starter_key, "name"))
    for index, group in enumerate(_list(document, "group")):
        if isinstance(group, Mapping):
            mend = "each group needs a name that no starter and no other group has"
            yield from _again(seen, ("group", index, "name"), _text(group, "name"), mend)


def _feeders(document: Document) -> Iterator[Mistake]:
    """Tell starters for which a feeder is named without a time, or a time without a feeder."""
    shared = [table for table in _list(document, "rules") if isinstance(table, Mapping)]
    for key, line in _lines(document):
        for starter_key, starter in _starters(key, line):
            name = _text(starter, "name")
            tables = [t for t in shared if any(_fits(name, p) for p in _list(t, "starters"))]
            own = {named for table in (*tables, _table(starter, "rules")) for named in table}
            for one, other in (("feeder", "stagger_s"), ("stagger_s", "feeder")):
                if one in own and other not in own:
                    mend = "a feeder and the time between two starts on it go together"
                    yield Mistake((*starter_key, "name"), f"{short(name)} has {one} without {other}", mend)


def _simulated(document: Document) -> Iterator[Mistake]:
    """Tell what a simulated starter of its family does not have."""
    for key, line in _lines(document):
        for starter_key, starter in _starters(key, line):
            if not _is_family(starter):
                continue
            profile = load_profile(starter["family"])
            table = _table(starter, "simulated")
            for code in _table(table, "parameters"):
                row = profile.parameters.get(code)
                if row is None or row.table.is_bits or row.words != 1:
                    mend = (
                        "name a parameter of one register by its code in the manual, such as P314 or C8.2.5.3"
                    )
                    where = (*starter_key, "simulated", "parameters", code)
                    yield Mistake(where, f"{profile.family} has no such parameter", mend)
            if table.get("braking_s") and profile.family not in ("ssw06", "ssw07"):
                mend = "leave it out" if profile.family == "sst" else "set C7.4.1 and C7.4.2 as parameters"
                yield Mistake((*starter_key, "simulated", "braking_s"), "is for ssw06 and ssw07", mend)


def _fits(name: str, pattern: object) -> bool:
    return isinstance(pattern, str) and fnmatch.fnmatchcase(name, pattern)


def _lines(document: Document) -> Iterator[tuple[Key, Document]]:
    for index, line in enumerate(_list(document, "line")):
        if isinstance(line, Mapping):
            yield ("line", index), line


def _starters(key: Key, line: Document) -> Iterator[tuple[Key, Document]]:
    for index, starter in enumerate(_list(line, "starter")):
        if isinstance(starter, Mapping):
            yield (*key, "starter", index), starter


def _table(document: Document, name: str) -> Document:
    table = document.get(name)
    return table if isinstance(table, Mapping) else {}


def _list(document: Document, name: str) -> list[Any]:
    items = document.get(name)
    return items if isinstance(items, list) else []


def _text(table: Document, name: str) -> str:
    text = table.get(name)
    return text if isinstance(text, str) else ""

"""Payloads that are no commands, made by a seeded mutator."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator

BIG_BYTES = 1_000_000
BIG_EVERY = 5000  # one in so many
VERBS = (
    "start",
    "set",
    "read",
    "reset",
    "jog",
    "direction",
    "general_enable",
)  # never stop: it needs no payload
NAMES = ("+", "#", "P+", "P#", "pump-*", "$SYS", "P314/#", "a/b", "", " ", "P314\u0000", "../../etc", "％")
NUMBERS = (2**63, -(2**64), 10**18, 10**400, -1, 2**31, 65536)


class Mutator:
    """Makes a verb and a payload; none of them may be acted on, though `token` gives a right one."""

    def __init__(self, seed: int, token: Callable[[], str]) -> None:
        self._dice = random.Random(seed)
        self._token = token
        self._number = 0
        self._ways: tuple[Callable[[], bytes], ...] = (
            self._not_json,
            self._cut,
            self._deep,
            self._no_number,
            self._huge_number,
            self._twice,
            self._wrong_utf8,
            self._wrong_type,
            self._unknown_key,
            self._wild_names,
            self._oversized,
            self._no_object,
        )

    def payloads(self, count: int) -> Iterator[tuple[str, bytes]]:
        """Return verbs and payloads, some of 1 MB."""
        for number in range(count):
            if number % BIG_EVERY == BIG_EVERY - 1:
                yield "start", b'{"id":"' + b"x" * BIG_BYTES + b'"}'
                continue
            way = self._ways[number % len(self._ways)]
            verb = "set" if way in (self._wild_names, self._huge_number) else self._dice.choice(VERBS)
            yield verb, way()

    def _fields(self, **more: object) -> dict[str, object]:
        self._number += 1
        return {"id": f"bad-{self._number}", "token": self._token(), **more}

    def _text(self, **more: object) -> str:
        return json.dumps(self._fields(**more))

    def _not_json(self) -> bytes:
        return self._dice.randbytes(self._dice.randrange(1, 200)).replace(b"{", b"(")

    def _cut(self) -> bytes:
        text = self._text(args={"parameter": "P314", "value": 30})
        return text[: self._dice.randrange(len(text))].encode()

    def _deep(self) -> bytes:
        depth = self._dice.randrange(9, 1500)
        opening, closing = self._dice.choice((("[", "]"), ('{"a":', "}")))
        inner = opening * depth + "1" + closing * depth
        return self._text().replace("}", f', "args": {{"a": {inner}}}}}').encode()

    def _no_number(self) -> bytes:
        word = self._dice.choice(
            ("NaN", "Infinity", "-Infinity", "1e999", "-1e400", "nan", "0x10", "01", "+1")
        )
        return self._text(args={"parameter": "P314", "value": "@"}).replace('"@"', word).encode()

    def _huge_number(self) -> bytes:
        digits = str(self._dice.choice(NUMBERS))
        if self._dice.random() < 0.5:
            digits = "9" * self._dice.randrange(20, 3000)
        return self._text(args={"parameter": "P314", "value": "@"}).replace('"@"', digits).encode()

    def _twice(self) -> bytes:
        key = self._dice.choice(("id", "token", "args"))
        text = self._text(args={})
        return f'{text[:-1]}, "{key}": {json.dumps(self._fields(args={})[key])}}}'.encode()

    def _wrong_utf8(self) -> bytes:
        bad = self._dice.choice((b"\xff", b"\xc0\x80", b"\xed\xa0\x80", b"\xf8\x88\x80\x80\x80", b"\xe2\x82"))
        payload = self._text(operator="@").encode()
        return payload.replace(b"@", bad)

    def _wrong_type(self) -> bytes:
        key = self._dice.choice(("id", "token", "operator", "reason", "issued_at", "ttl_s", "args", "expect"))
        values: tuple[object, ...] = ([], [1], True, [[]], "\x1b[2J" if key != "ttl_s" else "5")
        fields = {**self._fields(), key: self._dice.choice(values)}
        if key in ("id", "token", "operator") and fields[key] is None:
            fields[key] = 7
        return json.dumps(fields).encode()

    def _unknown_key(self) -> bytes:
        return self._text(
            **{self._dice.choice(("Id", "verb", "now", "$where", "__proto__", "\x00")): 1}
        ).encode()

    def _wild_names(self) -> bytes:
        args = {"parameter": self._dice.choice(NAMES), "value": 1}
        return self._text(args=args).encode()

    def _oversized(self) -> bytes:
        return self._text(reason="r" * self._dice.randrange(4097, 60_000)).encode()

    def _no_object(self) -> bytes:
        return self._dice.choice(
            (b"[]", b"null", b"1", b'"start"', b"true", b"", b" ", b"\x00", b"{}{}", b"\xef\xbb\xbf{}")
        )

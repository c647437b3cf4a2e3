"""Makes docs/reference/topics.md from the topics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tests.reference.fields import Field
from tests.reference.topics import TOPICS, Topic

HEAD = """\
# Topics and payloads

<!-- Made by `make docs` from tests/reference/topics.py, which the tests compare with the program. -->

`B` is `mqtt.base`, by default `starters/` and the gateway's name.
The same for programs: [asyncapi.yaml](asyncapi.yaml) (AsyncAPI 3).

- No topic that carries a payload is a prefix of another.
- Every level is made of `a-z`, `0-9`, `_` and `-`, those of `B` too; `B` may have any number of them.
- Times are UTC, RFC 3339 with milliseconds.
- Numbers that may have decimals always have some; there is no NaN.
- A field may be absent only where this page says so.
- New fields may be added; a program must ignore what it does not know. A command alone
  may have no other fields.
- An empty retained payload deletes a topic at the broker, because its starter, line or alarm is gone.
- What is published again is the same, byte for byte: a program removes duplicates by topic, `boot` and `seq`.
  An item of `history` is the message of `value/{point}` with the same two. A result has neither:
  its topic, `id`, `phase`, `duplicate` and `time` name it.
"""
KINDS = {
    "text": "text",
    "whole": "whole number",
    "number": "number",
    "flag": "true, false",
    "time": "time",
    "any": "any",
    "object": "object",
    "map": "object by key",
    "list": "list",
}


def page() -> str:
    """Return the page."""
    rows = [f"| [`{_address(topic)}`](#{_anchor(topic)}) | {topic.meaning} |" for topic in TOPICS]
    head = ["| topic | what |", "|---|---|"]
    return "\n".join([HEAD, *head, *rows, "", *(_section(topic) for topic in TOPICS)])


def _section(topic: Topic) -> str:
    retained = "retained" if topic.is_retained else "never retained" if topic.is_received else "not retained"
    deleted = " An empty payload deletes it." if topic.is_deletable else ""
    extra = [f"| *others* | | | {topic.extra} |"] if topic.extra else []
    return "\n".join(
        [
            f"## `{_address(topic)}` {{#{_anchor(topic)}}}",
            "",
            topic.meaning,
            f"QoS {topic.qos}, {retained}.{deleted}",
            "",
            "| field | type | unit | meaning |",
            "|---|---|---|---|",
            *_rows(topic.fields, ""),
            *extra,
            "",
        ]
    )


def _rows(fields: Mapping[str, Field], path: str) -> Iterator[str]:
    for name, field in fields.items():
        yield f"| `{path}{name}` | {_kind(field)} | {field.unit} | {_meaning(field)} |"
        inner = {"map": ".*.", "list": "[].", "object": "."}.get(field.kind, "")
        yield from _rows(field.inside, f"{path}{name}{inner}")


def _kind(field: Field) -> str:
    kind = KINDS[field.kind] + (f" of {KINDS[field.of]}" if field.of and field.of != "any" else "")
    return ", ".join(
        [kind, *(["or null"] if field.may_be_null else []), *(["or absent"] if field.may_be_absent else [])]
    )


def _meaning(field: Field) -> str:
    values = " ".join(f"`{value}`" for value in field.values)
    return f"{field.meaning}{f' ({values})' if values else ''}"


def _address(topic: Topic) -> str:
    return f"B/{topic.address}"


def _anchor(topic: Topic) -> str:
    return topic.name.lower()

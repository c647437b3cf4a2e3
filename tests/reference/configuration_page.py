"""Makes docs/reference/configuration.md from the models of the configuration."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from gateway.config import values
from gateway.config.schema import Config
from tests.reference import markdown

HEAD = """\
# Configuration

<!-- Made by `make docs` from gateway/config/schema.py; edit the descriptions there. -->

One TOML file describes a site.
`starter-gateway check FILE` names every mistake with its key and line;
`starter-gateway schema` prints all of this as JSON Schema, for editors.
File names are relative to the configuration's folder.
Names are levels of topics: `a-z`, `0-9`, `_` and `-`, at most 64 of them.
"""
UNITS = {"baud": "bit/s", "starts_per_hour": "1/h"}  # else by the end of the key
ENDINGS = {"_s": "s", "_pct": "%", "_a": "A", "_days": "d", "_hours": "h", "_mb": "MB"}
Schema = Mapping[str, Any]


class Key(NamedTuple):
    """One key of a table."""

    name: str
    kind: str
    unit: str
    default: str
    limits: str
    meaning: str


class Table(NamedTuple):
    """One table of the file: its header in TOML, what it is, and its keys."""

    header: str
    meaning: str
    keys: tuple[Key, ...]


def tables() -> tuple[Table, ...]:
    """Return the tables in the order of the models, required keys first; inner tables stand behind."""
    schema = Config.model_json_schema()
    return tuple(_tables(schema, schema, "", is_list=False))


def page() -> str:
    """Return the page."""
    return "\n".join([HEAD, *(_section(table) for table in tables() if table.keys)])


def _section(table: Table) -> str:
    rows = ((f"`{key.name}`", *key[1:]) for key in table.keys)
    head = ("key", "type", "unit", "default", "limits", "meaning")
    return markdown.table(f"## `{table.header}`\n\n{table.meaning}", head, rows)


def _tables(root: Schema, node: Schema, path: str, *, is_list: bool) -> Iterator[Table]:
    required = node.get("required", ())
    keys = [
        _key(root, name, each, is_required=name in required)
        for name, each in sorted(node["properties"].items(), key=lambda item: item[0] not in required)
        if _table_of(root, each) is None
    ]
    if path:
        header = f"[[{path}]]" if is_list else f"[{path}]"
        yield Table(header, _sentence(node["description"]), tuple(keys))
    for name, each in node["properties"].items():
        inner = _table_of(root, each)
        if inner is not None:
            table, inner_is_list = inner
            yield from _tables(root, table, f"{path}.{name}" if path else name, is_list=inner_is_list)


def _sentence(description: str) -> str:
    """Return what stands behind the table's name, as a sentence."""
    text = description.partition(": ")[2]
    return text[:1].upper() + text[1:]


def _table_of(root: Schema, node: Schema) -> tuple[Schema, bool] | None:
    """Return the table that a key stands for, and whether there may be several; None for a plain value."""
    for each in (node, *node.get("anyOf", ())):
        if "$ref" in each:
            return root["$defs"][each["$ref"].rpartition("/")[2]], False
        if "$ref" in each.get("items", {}):
            return root["$defs"][each["items"]["$ref"].rpartition("/")[2]], True
    return None


def _key(root: Schema, name: str, node: Schema, *, is_required: bool) -> Key:
    values = [each for each in node.get("anyOf", (node,)) if each.get("type") != "null"]
    value = values[0]
    default = "**required**" if is_required else _default(node.get("default"))
    return Key(name, _kind(value), _unit(name), default, _limits(value), str(node.get("description", "")))


def _kind(value: Schema) -> str:
    if "enum" in value or "const" in value:
        return "choice"
    names = {"integer": "whole number", "number": "number", "string": "text", "boolean": "true or false"}
    if value.get("type") == "array":
        return f"list: {_kind(value['items'])}"
    if value.get("type") == "object":
        return f"table of code = {_kind(value['additionalProperties'])}"
    if value.get("format") in ("path", "file-path"):
        return "path"
    return names[value["type"]]


def _unit(name: str) -> str:
    return UNITS.get(name) or next((unit for end, unit in ENDINGS.items() if name.endswith(end)), "")


def _default(value: object) -> str:
    if value is None:
        return "absent"
    if value in ([], (), {}):
        return "none"
    return f"`{json.dumps(value)}`"


def _limits(value: Schema) -> str:
    if value.get("type") == "array":
        least = value.get("minItems")
        return ", ".join(filter(None, [f"at least {least}" if least else "", _limits(value["items"])]))
    if value.get("type") == "object":
        return _limits(value["additionalProperties"])
    if "enum" in value:
        return " ".join(f"`{each}`" for each in value["enum"])
    low, high = value.get("minimum"), value.get("maximum")
    above, below = value.get("exclusiveMinimum"), value.get("exclusiveMaximum")
    parts = [
        f"from {low:g}" if low is not None else f"over {above:g}" if above is not None else "",
        f"to {high:g}" if high is not None else f"below {below:g}" if below is not None else "",
    ]
    if "pattern" in value:
        pattern = str(value["pattern"])
        parts.append(values.PATTERN_HINTS.get(pattern, "printed by `web-password`").replace("*", "\\*") + ",")
    if value.get("maxLength", 1024) < 1024:
        parts.append(f"at most {value['maxLength']} characters")
    return " ".join(filter(None, parts)).rstrip(",")

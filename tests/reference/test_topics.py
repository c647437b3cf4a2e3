"""The page of the topics has every record and every field, with its meaning and its unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from gateway import contract
from gateway.contract import Record
from tests.reference.contract_pages import TOPICS, Topic


def test_the_page_has_every_record_of_the_contract_that_is_published() -> None:
    found = {each for each in vars(contract).values() if isinstance(each, type) and issubclass(each, Record)}

    assert {topic.kind for topic in TOPICS} - {None} == {each for each in found if getattr(each, "TOPIC", "")}


def parts(schema: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the fields of a schema, with all that they contain."""
    for name, each in schema.get("properties", {}).items():
        yield f"{path}{name}", each
        yield from parts(each, f"{path}{name}.")
    for name in ("items", "additionalProperties"):
        if name in schema:
            yield from parts(schema[name], path)


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_every_field_has_a_meaning_and_a_number_of_seconds_its_unit(topic: Topic) -> None:
    fields = dict(parts(topic.schema))

    assert [path for path, each in fields.items() if not each.get("description")] == []
    seconds = {path: each for path, each in fields.items() if path.endswith("_s")}
    numbers = {path: each["description"] for path, each in seconds.items() if "number" in each["type"]}
    assert {path: text for path, text in numbers.items() if ", s" not in text} == {}

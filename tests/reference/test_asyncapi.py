from __future__ import annotations

import json
import os
import re
from functools import reduce
from operator import getitem

import pytest
import yaml
from jsonschema import Draft7Validator

from tests.reference.contract_pages import document
from tests.reference.pages import FOLDER

SCHEMA = FOLDER.parent / "build" / "asyncapi" / "3.0.0.json"  # by get-asyncapi.sh
FILE = FOLDER / "reference" / "asyncapi.yaml"


def test_the_file_is_asyncapi_3() -> None:
    if not SCHEMA.exists():
        assert os.environ.get("CI") != "true", "tests/reference/get-asyncapi.sh could not fetch the schema"
        pytest.skip("the published schema of AsyncAPI is not here (npm is needed; make asyncapi)")
    schema = json.loads(SCHEMA.read_text("utf-8"))

    errors = Draft7Validator(schema).iter_errors(yaml.safe_load(FILE.read_text("utf-8")))

    assert [f"{'.'.join(map(str, error.path))}: {error.message[:200]}" for error in errors] == []


def test_every_payload_is_a_right_json_schema() -> None:
    for message in document()["components"]["messages"].values():
        Draft7Validator.check_schema(message["payload"])


def closed_objects(node: object, path: str = "") -> list[str]:
    """Return where a schema permits no other fields."""
    if not isinstance(node, dict):
        return []
    here = [path] if node.get("additionalProperties") is False else []
    return here + [each for key, value in node.items() for each in closed_objects(value, f"{path}/{key}")]


def test_fields_may_be_added_to_everything_but_a_command() -> None:
    assert closed_objects(document()["components"]["messages"]) == ["/command/payload"]


def test_what_is_retained_of_a_starter_or_a_line_can_be_deleted_by_an_empty_payload() -> None:
    whole = document()
    deletable = {name for name, each in whole["channels"].items() if "deleted" in each["messages"]}

    starters = {"starterInfo", "starterAvailability", "starterState", "starterValue", "starterAlarm"}
    assert deletable == starters | {"lineStatistics"}
    deleted = Draft7Validator(whole["components"]["messages"]["deleted"]["payload"])
    assert (deleted.is_valid(""), deleted.is_valid("{}")) == (True, False)


def test_every_reference_in_the_file_leads_somewhere() -> None:
    whole = document()

    for ref in re.findall(r'"\$ref": "#/([^"]+)"', json.dumps(whole)):
        reduce(getitem, ref.split("/"), whole)

from __future__ import annotations

import json

import pytest

from gateway.cli.main import main
from gateway.config.schema import Config
from tests.reference.configuration_page import tables


def test_every_table_and_every_key_has_a_description_and_a_time_its_unit() -> None:
    keys = [(table.header, key) for table in tables() for key in table.keys]

    assert [table.header for table in tables() if not table.meaning] == []
    assert [(header, key.name) for header, key in keys if not key.meaning.endswith((".", ")"))] == []
    assert {key.unit for _, key in keys if key.name.endswith("_s")} == {"s"}
    assert len(tables()) >= sum(name.endswith("Table") for name in Config.model_json_schema()["$defs"])


def test_the_schema_says_what_each_key_means(capsys: pytest.CaptureFixture[str]) -> None:
    main(["schema"])
    schema = json.loads(capsys.readouterr().out)

    assert schema["$defs"]["LineTable"]["properties"]["baud"]["description"].startswith("Rate")

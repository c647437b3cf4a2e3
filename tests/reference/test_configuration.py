from __future__ import annotations

import json

import pytest

from gateway.cli.main import main
from gateway.config.schema import Config
from tests.reference.configuration_page import tables, undescribed


def test_every_key_of_the_configuration_has_a_description() -> None:
    assert undescribed() == []  # else: Field(description=..) in gateway/config/schema.py


def test_every_table_has_a_description() -> None:
    assert [table.header for table in tables() if not table.meaning] == []


def test_every_description_is_a_sentence() -> None:
    keys = [(table.header, key) for table in tables() for key in table.keys]

    assert [(header, key.name) for header, key in keys if not key.meaning.endswith((".", ")"))] == []


@pytest.mark.parametrize("ending", ["_s"])
def test_every_time_has_its_unit(ending: str) -> None:
    keys = [key for table in tables() for key in table.keys]

    assert {key.unit for key in keys if key.name.endswith(ending)} == {"s"}


def test_the_page_names_every_table_of_the_models() -> None:
    models = {name for name in Config.model_json_schema()["$defs"] if name.endswith("Table")}

    assert len(tables()) >= len(models)


def test_the_schema_says_what_each_key_means(capsys: pytest.CaptureFixture[str]) -> None:
    main(["schema"])
    schema = json.loads(capsys.readouterr().out)

    assert schema["$defs"]["LineTable"]["properties"]["baud"]["description"].startswith("Rate")

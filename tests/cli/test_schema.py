from __future__ import annotations

import json
import tomllib

import pytest

from gateway.cli.main import main
from gateway.config.schema import Verb
from gateway.families.command.build import verbs
from gateway.families.profile.load import FAMILIES, load_profile
from tests.config.sites import SITE

TABLES = {
    "gateway",
    "mqtt",
    "line",
    "operator",
    "rules",
    "group",
    "web",
    "metrics",
    "homeassistant",
    "sparkplug",
}


def test_the_schema_names_the_keys_as_the_file_has_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0

    schema = json.loads(capsys.readouterr().out)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert set(tomllib.loads(SITE)) <= set(schema["properties"]) == TABLES
    assert schema["required"] == ["gateway", "mqtt", "line"]
    assert schema["additionalProperties"] is False
    assert schema["$defs"]["StarterTable"]["properties"]["address"]["maximum"] == 247


@pytest.mark.parametrize("family", FAMILIES)
def test_every_familys_verbs_may_be_given_to_an_operator(family: str) -> None:
    assert set(verbs(load_profile(family))) <= set(Verb.__args__)  # type: ignore[attr-defined]  # of the Literal

"""Names and topics of an edge node."""

from __future__ import annotations

import pytest
from pydantic import TypeAdapter, ValidationError

from gateway.config.values import Name, SparkplugId


@pytest.mark.parametrize("text", ["a+b", "a/b", "#", "", "a\n", "a\x00b"])
def test_reserved_signs_are_refused_in_ids(text: str) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(SparkplugId).validate_python(text)
    with pytest.raises(ValidationError):
        TypeAdapter(Name).validate_python(text)


def test_names_of_starters_are_lower_case_so_none_differs_by_case_alone() -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Name).validate_python("Pump")

from __future__ import annotations

import pytest

from gateway.modbus.codes import ExceptionCode, Function, exception_name


def test_the_functions_have_the_numbers_of_the_specification() -> None:
    assert [int(function) for function in Function] == [1, 2, 3, 4, 5, 6, 15, 16, 22, 23, 43]


def test_the_exceptions_have_the_numbers_of_the_specification() -> None:
    assert [int(code) for code in ExceptionCode] == [1, 2, 3, 4, 5, 6, 8, 10, 11]


@pytest.mark.parametrize("code", ExceptionCode)
def test_every_exception_has_a_name_in_words(code: ExceptionCode) -> None:
    assert exception_name(code).replace(" ", "").isalpha()


@pytest.mark.parametrize(
    ("code", "name"), [(2, "illegal data address"), (4, "server device failure"), (6, "server device busy")]
)
def test_a_known_exception_is_named_as_in_the_specification(code: int, name: str) -> None:
    assert exception_name(code) == name


@pytest.mark.parametrize("code", [0, 7, 9, 255])
def test_an_unknown_exception_is_shown_by_its_number(code: int) -> None:
    assert exception_name(code) == f"exception {code}"

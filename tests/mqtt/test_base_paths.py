"""Base paths of any depth: what `check` accepts is what topics, commands and `watch` work with."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from gateway.config.values import Base
from gateway.contract import Topics

ODD = st.text(st.characters(exclude_categories=["Cs"]) | st.sampled_from("/+#$ a{}A\u00e4\t"), max_size=24)


@given(ODD)
@settings(max_examples=60)
@example("acme/site1/area/line3/mcc1")
@example("acme/site 1")
@example("acme/sito\u0301")
@example("$share/group/acme")
@example("$SYS")
@example("acme/+/mcc1")
@example("acme/#")
@example("acme//mcc1")
@example("/acme")
@example("acme/")
@example("Acme")
@example("acme/{gateway}/{gateway}-b")
@example("acme/{other}")
@example("acme\n")
@example("\N{FULLWIDTH LATIN SMALL LETTER A}")
def test_check_accepts_exactly_what_makes_topics(base: str) -> None:
    try:
        accepted = TypeAdapter(Base).validate_python(base)
    except ValidationError:
        with pytest.raises(ValueError, match="is no topic level"):
            Topics(base.replace("{gateway}", "mcc1"))
    else:
        assert Topics(accepted.replace("{gateway}", "mcc1")).base

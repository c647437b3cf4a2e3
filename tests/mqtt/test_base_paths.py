"""Base paths of any depth: what `check` accepts is what topics, commands and `watch` work with."""

from __future__ import annotations

import json

from hypothesis import example, given, settings
from hypothesis import strategies as st

from gateway.config.reading import parse
from gateway.contract import Topics
from gateway.errors import ConfigError
from tests.config.sites import changed

ODD = st.text(st.characters(exclude_categories=["Cs"]) | st.sampled_from("/+#$ a{}A\u00e4\t"), max_size=24)


def accepted_base(base: str) -> str | None:
    """Return the base that a site with this `mqtt.base` gets; None when it is refused, with key and line."""
    text = json.dumps(base, ensure_ascii=False).replace(
        "\x7f", "\\u007f"
    )  # TOML's texts are JSON's but for this
    try:
        return parse(changed(("[mqtt]", f"[mqtt]\nbase = {text}")), "site.toml").base
    except ConfigError as error:
        return None if "line 5: mqtt.base: " in str(error) else f"another mistake: {error}"


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
    filled = base.replace("{gateway}", "mcc1")
    try:
        topics = Topics(filled)
    except ValueError:
        assert accepted_base(base) is None
    else:
        assert accepted_base(base) == topics.base == filled

"""What faults, rows and points are called: complete, from the manual, in the languages that it has."""

from __future__ import annotations

import pytest

from gateway.errors import UsageError
from gateway.families.profile.load import FAMILIES, LANGUAGES, load_profile
from gateway.families.profile.names import meaning_of, printed_name
from gateway.families.profile.parameters import to_words
from gateway.families.profile.rows import Confidence
from tests.families.notation import table


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("language", LANGUAGES)
def test_every_point_has_a_printed_name_and_a_meaning(family: str, language: str) -> None:
    profile = load_profile(family, language)

    assert all(printed_name(profile, name) and meaning_of(profile, name) for name in profile.points)
    assert not any("not named" in printed_name(profile, name) for name in profile.points)


NAMES = """
ssw07  | fault         | Error                | false: no error; true: with error
ssw07  | p030          | Phase R current      | current of phase R
ssw900 | bypass_closed | Bypass               | false: Bypass open; true: Bypass closed
sst    | running       | Motor status         | true: motor starting, motor at speed
sst    | remote        | USB is controller, Physical start/stop is controller | true: neither coil7 nor coil8
sst    | coil17        | Phase loss           | true: Phase loss
sst    | line_voltage  | Mains voltage        | mean voltage of the supply, phase to phase
"""


@pytest.mark.parametrize(("family", "point", "name", "meaning"), table(NAMES))
def test_a_point_is_named_as_the_manual_prints_it(family: str, point: str, name: str, meaning: str) -> None:
    profile = load_profile(family)

    assert (printed_name(profile, point), meaning_of(profile, point)) == (name, meaning)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_name_that_no_manual_at_hand_confirms_says_so(family: str) -> None:
    for alarm in load_profile(family).alarms:
        assert alarm.source
        assert (alarm.confidence is Confidence.INFERRED) == ("not in this manual" in alarm.text)


def test_spanish_names_stand_where_the_manual_has_them_and_english_ones_elsewhere() -> None:
    spanish, english = load_profile("ssw06", "es"), load_profile("ssw06")

    assert spanish.alarms[0].text == "Comunicación Serie Inactiva"  # codespell:ignore
    assert [a.code for a in spanish.alarms] == [a.code for a in english.alarms]
    assert printed_name(spanish, "current") == "corriente del motor en amperes"
    assert meaning_of(spanish, "fault") == "false: sin error; true: con error"
    assert spanish.enums["P313"][2] == "deshabilita general"
    for value in ("Fatal error", "causa error fatal", 5):  # programs go on as they are
        assert to_words(spanish, spanish.parameters["P313"], value) == (5,)
    assert meaning_of(load_profile("ssw07", "es"), "fault") == meaning_of(load_profile("ssw07"), "fault")
    assert spanish.parameters["P277"].name == "relay RL1 function"
    assert spanish.rows_at.keys() == english.rows_at.keys()
    assert all(row is spanish.parameters[row.code] for rows in spanish.rows_at.values() for row in rows)


def test_a_family_or_a_language_that_does_not_exist_is_refused_with_those_that_do() -> None:
    for family in ("ssw08", "", "../ssw07"):
        with pytest.raises(UsageError, match="there are sst, ssw06, ssw07, ssw900"):
            load_profile(family)
    with pytest.raises(UsageError, match="no language 'de'; there are en, es, pt"):
        load_profile("ssw06", "de")

"""The one word for a starter's state, from the words of each family."""

from __future__ import annotations

import pytest

from tests.rig import msg, play, row
from tests.rig.sites import SITES

SST_READY = "R19 = 0, COIL5 = 1, COIL26 = 1, COIL9 = 0"

WORDS = [  # starter, its words, the state, booleans of it
    # SSW-07, 4.2.1: bits 15 fault, 14 power, 12 bypass, 9 braking, 8 remote, 7, 3 ramps, 1 enabled, 0 running
    ("pump", "VB01 = 0x4102", "ready", {"remote": True, "general_enabled": True, "running": False}),
    ("pump", "VB01 = 0x4002", "ready", {"remote": False}),
    ("pump", "VB01 = 0x410B", "starting", {"running": True, "accelerating": True, "full_voltage": False}),
    ("pump", "VB01 = 0x411B", "starting", {"current_limit": True}),
    ("pump", "VB01 = 0x5123", "running", {"full_voltage": True, "bypass_closed": True}),
    ("pump", "VB01 = 0x4182", "stopping", {"running": False, "decelerating": True}),
    ("pump", "VB01 = 0x4106", "running", {"jog": True}),
    ("pump", "VB01 = 0x4302", "running", {"braking": True}),
    ("pump", "VB01 = 0x4D02", "running", {"reversing": True, "reverse": True}),
    ("pump", "VB01 = 0x8000", "fault", {"fault": True, "power_present": False}),
    ("pump", "VB01 = 0xC10B", "fault", {"fault": True, "accelerating": True}),  # a fault goes before all
    ("pump", "VB01 = 0x4100", "not_ready", {"general_enabled": False}),
    ("pump", "VB01 = 0x0102", "not_ready", {"power_present": False}),
    # SSW-06, 4.2.2: as the SSW-07, with bit 6 alarm; VB06 is an adjusting mode
    ("fan", "VB01 = 0x4102", "ready", {"alarm": False}),
    ("fan", "VB01 = 0x4142", "ready", {"alarm": True}),
    ("fan", "VB01 = 0x410B", "starting", {"accelerating": True}),
    ("fan", "VB01 = 0x5123", "running", {"bypass_closed": True}),
    ("fan", "VB01 = 0x4182", "stopping", {"running": False}),
    ("fan", "VB01 = 0x8002", "fault", {"fault": True}),
    ("fan", "VB01 = 0x0102", "not_ready", {"power_present": False}),
    ("fan", "VB01 = 0x4102, VB06 = 2", "not_ready", {"general_enabled": True}),
    # SSW900, S5.1: bits 3 initial test, 4 and 7 ramps, 5 full voltage, 6 bypass, 12 and 13 waiting times
    ("mill", "S5.1.1 = 0x0102", "ready", {"remote": True, "alarm": False}),
    ("mill", "S5.1.1 = 0x010A", "starting", {"running": False}),  # initial test
    ("mill", "S5.1.1 = 0x1102", "starting", {"running": False}),  # time before start
    ("mill", "S5.1.1 = 0x0113", "starting", {"accelerating": True}),
    ("mill", "S5.1.1 = 0x0163", "running", {"full_voltage": True, "bypass_closed": True}),
    ("mill", "S5.1.1 = 0x4163", "running", {"alarm": True}),
    ("mill", "S5.1.1 = 0x0183", "stopping", {"decelerating": True}),
    ("mill", "S5.1.1 = 0x0302", "running", {"braking": True}),
    ("mill", "S5.1.1 = 0x2102", "not_ready", {}),  # time after a stop: no start is carried out
    ("mill", "S5.1.1 = 0x0100", "not_ready", {"general_enabled": False}),
    ("mill", "S5.1.1 = 0x8102, D1.1.1 = 5", "fault", {"fault": True}),
    # SST: coil 9 error, coil 5 configured, coil 26 ready; R19 0 stopped, 1 starting, 2 at speed, 3 stopping
    ("belt", SST_READY, "ready", {"configured": True, "ready_to_start": True, "remote": True}),
    ("belt", SST_READY + ", R19 = 1", "starting", {"running": True, "accelerating": True}),
    ("belt", SST_READY + ", R19 = 2", "running", {"running": True, "full_voltage": True}),
    ("belt", SST_READY + ", R19 = 3", "stopping", {"running": False, "decelerating": True}),
    ("belt", SST_READY + ", COIL26 = 0", "not_ready", {"ready_to_start": False}),
    ("belt", SST_READY + ", COIL5 = 0", "not_ready", {"configured": False}),
    ("belt", SST_READY + ", COIL7 = 1", "ready", {"remote": False}),  # USB controls
    ("belt", SST_READY + ", COIL8 = 1", "ready", {"remote": False}),  # the inputs control
    ("belt", SST_READY + ", COIL9 = 1, COIL12 = 1, R19 = 2", "fault", {"fault": True}),
]


@pytest.mark.parametrize(("starter", "words", "state", "bits"), WORDS)
def test_words_give_the_state(starter: str, words: str, state: str, bits: dict[str, bool]) -> None:
    setting = [f"{starter} {word}" for word in words.split(", ")]
    is_so = msg(f"starter/{starter}/state", state=state, quality="good", retain=True, **bits)
    play(row(words, given=SITES[starter], at={0: setting}, then={2.5: is_so}).values[0])

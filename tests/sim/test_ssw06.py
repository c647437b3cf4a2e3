"""The simulated SSW-06 against the rules of its manual (S6-xx)."""

from __future__ import annotations

import pytest

from gateway.sim.factory import make_unit
from tests.sim.script import play, rules

RULES = {
    "S6-01 VB00 always reads 15": "VB00 = 15; VB00 := 1 refused 3",
    "S6-02 (motor) a value bit without its mask bit does nothing": """
        VB03 := 0003h; see motor.state stopped; see start_frames; VB01 = 4102h""",
    "S6-02 (motor) 0303h runs, 0100h stops by ramp, 0200h disables": """
        VB03 := 0303h; 10 s; see motor.state bypass; VB03 := 0100h; see motor.state ramp_down
        10 s; start; VB03 := 0200h; see motor.state coasting; VB01 & 2h = 0""",
    "S6-03 (motor) bits without mask keep their state": """
        VB03 := 0808h; start; see is_enabled True; see is_remote True; see is_reverse True; VB03 = 1Bh""",
    "S6-04 (motor) coils are the value bits without any mask": """
        coil 100 := 1; see motor.state ramp_up; coil 100 := 0; see motor.state ramp_down""",
    "S6-05 a reset needs no source, but an error": """
        given P220=2 P230=0
        VB03 := 8080h; VB01 = 4002h; trip 3; VB03 := 8000h; VB03 := 8080h sent; see fault 0""",
    "S6-06 E28 is not reset through the network": "trip 28; VB03 := 8080h; see fault 28; clear; see fault 0",
    "S6-06 E29 is not reset through the network": "trip 29; VB03 := 8080h; see fault 29; VB01 = C102h",
    "S6-06 E30 is not reset through the network": "trip 30; VB03 := 8080h; see fault 30",
    "S6-07 a command that is not set to serial is answered, but not executed": """
        given P230=0
        start; see motor.state stopped""",
    "S6-07 a command that is not set to serial may be refused": """
        given P230=0 is_command_refused=True
        VB03 := 0101h refused 3""",
    "S6-08 (motor) a run command during P630 looks like success": """
        given P630=5
        run; stop; 6 s; start; see motor.state stopped; 5 s; start; see motor.state ramp_up""",
    "S6-09 a reset restarts the device, which is silent meanwhile": """
        given answers_before_restart=True restart_s=3.0
        run; trip 3; VB03 := 8080h; 2.9 s; VB01 silent; 0.2 s; VB01 = 4102h""",
    "S6-09 a reset may not be answered": """
        given answers_before_restart=False restart_s=3.0
        run; trip 3; VB03 := 8080h silent; 2.9 s; VB01 silent; 0.2 s; VB01 = 4102h""",
    "a run bit in the word of the reset is lost in the restart": """
        trip 3; VB03 := 8181h sent; 10 s; see motor.state stopped; see starts""",
    "S6-10 (motor) a change of P202 leads into an adjusting mode": """
        run; P202 := 3; see motor.state coasting; VB06 = 2; 10 s; start; see motor.state stopped; P202 = 3""",
    "S6-10 P202 written unchanged does nothing": "P202 := 0; VB06 = 0",
    "S6-10 P204 = 5 loads the factory settings and adjusts": """
        P204 := 5; VB06 = 1; P220 = 2; see address 1""",
    "S6-10 writing VB07 leaves the mode by a restart": """
        P202 := 3; VB07 := 2 sent; VB01 silent; 4 s; VB06 = 0; start; see motor.state ramp_up""",
    "S6-11 VB07 is accepted only while VB06 shows that mode": "P202 := 3; VB07 := 1; VB06 = 2",
    "S6-11 VB07 in another mode may be refused": "given is_command_refused=True; VB07 := 1 refused 3",
    "S6-12 relays follow VB08 only where set to serial": """
        given P278=7 P279=7
        VB08 := 7; see relays 6""",
    "S6-13 analog outputs follow VB09 and VB10 with their gains": """
        given P251=7 P252=500
        VB09 := 16383 16383; see analog_pct 50.0 0.0; VB09 := 16384 refused 3""",
    "S6-14, S6-16 E28 clears the outputs and goes when telegrams return": """
        given P251=7 P277=7 P314=3
        VB08 := 1 100 0; 3.1 s; trips E28@3.0; VB08 = 0 0 0; see is_silence_shown False""",
    "S6-15 (motor) P313 = 0 does nothing": "given P313=0 P314=20; run; 30 s; trips E28@20.0; VB01 & 1h = 1",
    "S6-15 (motor) P313 = 4 does nothing": "given P313=4 P314=20; run; 30 s; trips E28@20.0; VB01 & 1h = 1",
    "S6-15 (motor) P313 = 1 stops by ramp": "given P313=1 P314=20; run; 11 s; see motor.state ramp_down",
    "S6-15 (motor) P313 = 2 disables": "given P313=2 P314=20; run; 11 s; see motor.state coasting",
    "S6-15 (motor) P313 = 3 goes local": "given P313=3 P314=20; run; 11 s; VB01 & 100h = 0",
    "S6-15 (motor) P313 = 5 is a fatal error that stays": """
        given P313=5 P314=20
        run; 30 s; VB01 & 8000h = 8000h; see is_silence_shown True; VB03 := 8080h; see fault 28
        clear; see fault 0""",
    "C-13 with the option a fatal E28 is reset through the network": """
        given P313=5 P314=20 is_e28_resettable=True
        run; 30 s; VB03 := 8080h sent; see fault 0""",
    "S6-17 P000 is taken, but not stored": "P000 := 5; P000 = 0",
    "S6-18 P200 and P215 cannot be reached": """
        P200 refused 2; P215 refused 2; P200 := 0 refused 2; P215 := 0 refused 2""",
    "S6-20 running goes to 0 as soon as a stop is received": "run; stop; VB01 & 81h = 80h",
    "S6-21 other functions get exception 1": "DI0 refused 1; IR2 refused 1",
    "S6-22 it says who it is": """
        2B 0E 01 00 -> 2B 0E 01 81 00 00 03 00 'WEG' 01 'SSW-06 85.0A' 02 'V1.60'""",
    "S6-23 what is out of range, read-only or does not exist is refused": """
        P220 := 11 refused 3; VB06 := 0 refused 3; P089 := 0 refused 2; VB02 refused 2; coil 16 refused 2""",
    "W-09 an exception is the function with bit 7 and one code": "16 03 EB 00 00 00 00 -> 96 01",
    "X-01 (motor) the word that runs an SSW-07 in local mode does nothing here": """
        given P229=2 P220=0
        VB03 := 3; see motor.is_turned_on False""",
    "reversal and direction have their bits": """
        run; VB03 := 0808h; VB01 & C00h = 400h; 5 s; VB01 & C00h = 800h; see motor.is_turned_on True""",
}
SERIAL = [f"{baud} {framing}" for baud in (9600, 19200, 38400) for framing in ("8N2", "8O1", "8E1")]
RULES |= {
    f"S6-24 P312 = {number} is {own}": f"join {own}; P312 = {number}; listens {own}; "
    + "; ".join(f"ignores {other}" for other in SERIAL if other != own)
    for number, own in enumerate(SERIAL, 1)
}


@pytest.mark.parametrize(("family", "script"), rules("ssw06", RULES))
def test_the_ssw06_keeps_the_rules_of_its_manual(family: str, script: str) -> None:
    play(family, script)


def test_s6_09_whether_the_reset_is_answered_is_left_to_chance() -> None:
    answers = {
        play("ssw06", f"given seed={seed}; trip 3").unit.handle(bytes.fromhex("06 13 8B 80 80"), 0.0) is None
        for seed in range(20)
    }

    assert answers == {True, False}


def test_s6_19_from_820_a_on_currents_are_divided_by_ten() -> None:
    for model, factor in (("820", 1), ("670", 10)):
        talk = play("ssw06", f"given model='{model}'; run")

        (percent, current) = (
            int.from_bytes(talk.unit.handle(bytes((3, 0, row, 0, 1)), talk.now_s)[2:]) for row in (2, 3)
        )

        assert current == pytest.approx(talk.unit.motor.current_a * factor, rel=0.02)
        assert percent == pytest.approx(talk.unit.motor.current_pct * 10, rel=0.02)


@pytest.mark.parametrize(
    ("family", "longest_s", "each_s"), [("ssw06", 0.010, 0.010), ("ssw07", 0.020, 0.020)]
)
def test_s6_21_and_s7_12_answers_take_their_time(family: str, longest_s: float, each_s: float) -> None:
    unit = make_unit(family, 1)
    read = bytes.fromhex("03 1389 0001")
    delays_s = [unit.response_delay_s(read) for _ in range(200)]

    assert 0.005 <= min(delays_s) < 0.006
    assert longest_s - 0.002 < max(delays_s) <= longest_s
    for count in (1, 2, 5):
        write = bytes((16, 1, 57, 0, count, 2 * count)) + bytes(2 * count)
        assert unit.response_delay_s(write) == pytest.approx(count * each_s)
        assert unit.longest_response_s(write) == pytest.approx(count * each_s)

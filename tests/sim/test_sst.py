"""The simulated SST against the rules of its manual (ST-xx)."""

from __future__ import annotations

import pytest

from tests.sim.script import play, rules

IDLE = "coil 1 = 0 0 0 0 1 1; coil 26 = 1"  # configured, and ready to start; coil 6 is always 1
BLANK = "coil 1 = 0 0 0 0 0 1; coil 26 = 0"
RULES = {
    "ST-01 other functions get exception 1": "0 refused 1; coil 1 := 1 1 refused 1",
    "ST-02 coil n is at n - 1 and register n at n": f"""
        {IDLE}; R0 = 330; coil 27 refused 2; coil 21 x7 refused 2; R42 x2 refused 2""",
    "ST-05 a request of more than 54 bytes is ignored": f"""
        coil 2 := 1; R20 := {"0 " * 23} silent; R20 := {"0 " * 22} refused 2""",
    "ST-06 an answer of more than 54 bytes is exception 4": "R0 x25 refused 4; R19 = 0",
    "ST-07 (motor) a starter is initialised by coil 2": f"""
        given is_configured=False
        {BLANK}; coil 2 := 1; coil 2 := 0; 1 s; {IDLE}""",
    "ST-07 (motor) after power-up the initialisation is due again": f"power off; power on; 3 s; {BLANK}",
    "ST-08 (motor) coil 2 stops the motor": """
        run; coil 2 := 1; see motor.state ramp_down; coil 1 = 0 1 0 0 0 1""",
    "ST-09 (motor) a start while coil 5 = 0 gets exception 2": """
        given is_configured=False
        coil 1 := 1 refused 2; see starts; see start_frames 0.0""",
    "ST-10 (motor) register 4 outside configuration mode": """
        run; R4 := 20 refused 2; see motor.state ramp_down; coil 1 = 0""",
    "ST-10 (motor) register 30 outside configuration mode": """
        run; R30 := 20 refused 2; see motor.state ramp_down; coil 1 = 0""",
    "ST-10 (motor) register 42 outside configuration mode": """
        run; R42 := 20 refused 2; see motor.state ramp_down; coil 1 = 0""",
    "registers that only report are refused and leave the motor alone": """
        run; R0 := 1 refused 2; R3 := 1 refused 2; R7 := 1 refused 2; R29 := 1 refused 2
        see motor.state bypass""",
    "registers that only report are refused in configuration mode too": "coil 2 := 1; R12 := 1 refused 2",
    "ST-11 only what differs is written to flash": """
        coil 2 := 1; coil 2 := 0; 1 s; coil 2 := 1; R32 := 20; coil 2 := 0; 1 s; see flash_writes 0
        coil 2 := 1; R32 := 25; coil 2 := 0; 1 s; see flash_writes 1; R32 = 25""",
    "ST-12 coil 5 becomes 1 after the flash write, until then writes get exception 6": """
        given flash_s=0.5
        coil 2 := 1; coil 2 := 0; 0.4 s; coil 5 = 0; coil 1 := 1 refused 6; coil 2 := 1 refused 6
        R30 := 20 refused 6
        0.2 s; coil 5 = 1; start""",
    "ST-13 only the low byte is stored and checked": """
        coil 2 := 1; R36 := 130h; R4 := 130h; R36 = 30h; R4 = 130h; R36 := 30FFh refused 3
        R30 := 20 99 refused 3""",
    "ST-13 ranges of an SST330i": "given model='SST330i-M'; coil 2 := 1; R30 := 47; R30 := 48 refused 3",
    "ST-13 ranges of an SST130i-75": """
        given model='SST130i-75-M'
        coil 2 := 1; R30 := 75; R30 := 5; R30 := 76 refused 3""",
    "ST-13 ranges of an SST130i-140": """
        given model='SST130i-140-M-ES'
        coil 2 := 1; R30 := 140; R30 := 141 refused 3""",
    "coils that only report cannot be written": "coil 5 := 1 refused 2; coil 26 := 1 refused 2",
    "ST-14 (motor) while USB controls every write gets exception 1": """
        do set_control usb; coil 1 := 1 refused 1; R30 := 20 refused 1; R30 := 20 1 refused 1
        coil 7 = 1 0""",
    "ST-14 (motor) while the inputs control every write gets exception 1": """
        control local; coil 1 := 1 refused 1; R30 := 20 refused 1; R30 := 20 1 refused 1; coil 7 = 0 1""",
    "ST-15 (motor) after a stop through USB the motor waits for a start": """
        run; do set_control usb; keypad stop; 10 s; do set_control modbus; 10 s; see motor.state stopped
        start; see motor.state ramp_up""",
    "ST-15 (motor) after a start through USB it runs on": """
        keypad start; see motor.state stopped; do set_control usb; keypad start; do set_control modbus
        keypad stop
        10 s; R19 = 2""",
    "ST-16 (motor) without mains coil 26 is 0 and a start does nothing": """
        mains off; start; coil 26 = 0; see starts""",
    "ST-17 (motor) register 41 stops the motor when no command comes": """
        coil 2 := 1; R41 := 12; coil 2 := 0; 1 s; start; 11 s; R0 = 330; 11 s; see motor.state bypass; 1.5 s
        trips R41@24.0; see motor.is_turned_on False; coil 1 = 0""",
    "ST-17 (motor) register 42 restarts the starter": f"""
        given R42=20
        run; 11 s; trips R42@20.0; coil 1 := 1 silent; 3 s; {BLANK}; see motor.is_turned_on False""",
    "ST-17 a starter with a short register 42 starts up once and waits": """
        given R42=1
        R42 = 1; 1000 s; trips R42@1.0; coil 2 := 1; R42 := 0; coil 2 := 0; 10 s; R42 = 0; trips R42@1.0""",
    "ST-17 at 0 nothing is supervised": "run; 10000 s; trips -",
    "ST-18, ST-19 errors have their coils and are reset by coil 3": f"""
        run; trip 17; coil 9 = 1 0 0 0 0 0 0 0 1; see motor.state coasting; start
        see motor.is_turned_on False
        coil 3 := 0; coil 9 = 1; coil 3 := 1; coil 9 = 0; {IDLE}; 10 s; see motor.state stopped""",
    "ST-19 coil 4 restarts the whole starter": f"""
        run; coil 4 := 0; see motor.state bypass; coil 4 := 1; coil 1 := 1 silent; 2.1 s; {BLANK}""",
    "ST-20 registers 0 to 42 can be read, the unused 21 too": f"""
        R0 x24 & 0h = {"0 " * 24}; R24 x19 & 0h = {"0 " * 19}; R21 = 0""",
    "ST-22 register 19 shows what the motor does": """
        R19 = 0; start; 0.5 s; R19 = 1; 5 s; R19 = 2; stop; 0.5 s; R19 = 3; 5 s; R19 = 0""",
    "ST-23 (motor) a single-phase motor starts once its capacitor is discharged": """
        given model='SST130i-75-M'
        start; 3 s; stop; 2 s; start; see motor.is_turned_on False; 10 s; see motor.is_turned_on True""",
    "ST-23 (motor) a stop calls the waiting start off": """
        given model='SST130i-140-M'
        start; 3 s; stop; 1 s; start; stop; 30 s; see motor.state stopped""",
    "ST-25 old firmware does not have the name": "given firmware='4.03'; R22 x8 refused 2",
    "ST-25 firmware 4.04 has the name": """
        given firmware='4.04'
        R22 = 5353h 5433h 3330h 692Dh 4D00h 0 0 0""",
    "versions are in low and high bytes": "given firmware='4.21'; R1 = 106h 204h 1",
    "errors are reset by themselves after register 40": f"""
        given R40=2
        trip 12; 30 s; R15 = 30 1; 91 s; {IDLE}; R15 = 0 0""",
    "a capacitor that was never charged is empty": "given model='SST130i-75-M'; see capacitor_v 0.0; R20 = 0",
    "ST-21 the heatsink temperature is a signed low byte": "let motor.heatsink_c -1.0; R13 = FFh",
    "ST-26 an answer repeats the request, filled in": """
        05 00 02 FF 00 -> 05 00 02 FF 00; 01 00 04 00 01 -> 01 01 01; 04 00 29 00 01 -> 04 02 00 00""",
    "ST-26 an error is answered with 80h and its code": "06 00 00 00 01 -> 86 02",
}


@pytest.mark.parametrize(("family", "script"), rules("sst", RULES))
def test_the_sst_keeps_the_rules_of_its_manual(family: str, script: str) -> None:
    play(family, script)


@pytest.mark.parametrize(("model", "factor"), [("SST330i", 1.0), ("SST130i-75-M", 1.2)])
def test_st_24_a_single_phase_model_shows_the_higher_stator_current(model: str, factor: float) -> None:
    talk = play("sst", f"given model='{model}'; run")
    reply = talk.unit.handle(bytes.fromhex("04 00 0C 00 01"), talk.now_s) or b""

    assert int.from_bytes(reply[2:]) == pytest.approx(talk.unit.motor.current_a * factor, abs=1)


def test_only_coils_10_to_21_name_an_error() -> None:
    with pytest.raises(ValueError, match="coil 9"):
        play("sst", "R19 = 0").unit.trip(9)

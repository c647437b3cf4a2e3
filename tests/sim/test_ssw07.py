"""The simulated SSW-07 and SSW-08 against the rules of their manual (S7-xx, W-xx)."""

from __future__ import annotations

import pytest

from tests.sim.script import play, rules

RULES = {
    "a start by coil leads to the ramp and the bypass": """
        VB01 = 4102h; start; 1 s; VB01 = 411Bh; 10 s; VB01 = 5123h; see starts 0.0""",
    "a stop by coil ramps down, and running is 0 at once": "run; stop; VB01 = 4182h; 5 s; VB01 = 4102h",
    "S7-01 (motor) a bare reset word also stops, disables and goes local": """
        given P229=0
        run; VB03 := 80h; see is_remote False; see motor.state coasting""",
    "S7-01 (motor) a bare reset word does so when local listens to serial too": """
        given P229=2
        run; VB03 := 80h; see is_remote False; see motor.state coasting""",
    "S7-01 (motor) a word that goes local and only stops ramps down": """
        run; VB03 := 2; see motor.state ramp_down""",
    "S7-01 (motor) a word that goes local and runs leaves the motor running": """
        run; VB03 := 3; see motor.state bypass; see is_in_control False""",
    "S7-01 (motor) the word starts when it also keeps remote and enable": """
        VB03 := 13h; see motor.state ramp_up; VB03 = 13h""",
    "B-10 the manual's own start word takes the control away from the network": """
        VB03 := 3; see motor.state stopped; see is_remote False; see start_frames 0.0; see starts""",
    "S7-02 (motor) a coil sets one command bit without touching the others": """
        run; coil 103 := 0; coil 107 := 0; see motor.state bypass; coil 100 = 1 1 0 0 1 0 0 0""",
    "S7-03 before V1.40 there is no jog and no direction": """
        given firmware='1.30'
        coil 102 := 1 1; see motor.state stopped; see is_reverse False; VB01 & C04h = 0""",
    "S7-03 from V1.40 on the motor jogs and reverses": """
        given firmware='1.40'
        coil 103 := 1; coil 102 := 1; VB01 & 804h = 804h; coil 102 := 0; VB01 & 4h = 0""",
    "a change of direction while running stops and starts the other way": """
        run; coil 103 := 1; VB01 & C80h = 480h; 5 s; VB01 & C08h = 808h; see starts 0.0""",
    "S7-04 bits 6 and 13 are never set": "run; trip 5; VB01 & 2040h = 0",
    "S7-05 a reset needs no command source": """
        given P220=2 P230=0
        trip 5; VB01 & 8000h = 8000h; coil 107 := 1; VB01 & 8000h = 0""",
    "S7-05 E28 is not reset through the network": """
        trip 28; coil 107 := 1; VB01 & 8000h = 8000h; clear; VB01 & 8000h = 0""",
    "W-13 a reset bit left at 1 does not reset again": """
        coil 107 := 1; trip 5; coil 107 := 1; VB01 & 8000h = 8000h
        coil 107 := 0; coil 107 := 1; VB01 & 8000h = 0""",
    "S7-06, W-12 (motor) in remote the keypad is the source": """
        given P230=0
        start; see motor.state stopped; see starts; see start_frames 0.0""",
    "S7-06, W-12 (motor) it is always local": "given P220=0; start; see motor.state stopped",
    "S7-06 a command that is not set to serial may be refused": """
        given P230=0 is_command_refused=True
        coil 100 := 1 refused 3; see motor.state stopped""",
    "W-12 (motor) serial switches local and remote only where P220 says so": """
        given P220=3
        coil 104 := 0; see is_remote True""",
    "W-12 (motor) serial switches local and remote where P220 says so": "coil 104 := 0; see is_remote False",
    "S7-07 (motor) a run command during P630 is ignored without error": """
        given P630=5
        run; stop; 4.5 s; start; see motor.state stopped; P006 = 11
        5 s; start; see motor.state ramp_up; see starts 0.0 19.5; see start_frames 0.0 14.5 19.5""",
    "S7-08 relays follow VB08 only where their function is serial": """
        given P277=7
        VB08 := 3; VB08 = 1; see relays 1""",
    "S7-09 E28 is shown after P314, outputs drop, and it goes when telegrams return": """
        given P277=7 P313=0
        VB08 := 1; P314 := 5; 4.9 s; trips -; 0.2 s; trips E28@5.0; see is_silence_shown True; see relays 0
        VB01 & 8000h = 0; see is_silence_shown False""",
    "S7-09 every valid telegram restarts the count": """
        given P314=5
        4 s; VB01 = 4102h; 4 s; VB01 = 4102h; 4 s; trips -""",
    "S7-09 P314 = 0 supervises nothing": "given P314=20; run; P314 := 0; 1000 s; trips -; VB01 & 1h = 1",
    "S7-10 (motor) P313 = 1 stops by ramp": "given P313=1 P314=20; run; 11 s; see motor.state ramp_down",
    "S7-10 (motor) P313 = 1 does nothing when serial does not control": """
        given P313=1 P314=20 P230=0
        keypad start; 21 s; trips E28@20.0; see motor.state bypass""",
    "S7-10 (motor) P313 = 3 does nothing where serial does not switch": """
        given P313=3 P314=20 P220=1
        run; 11 s; see is_remote True""",
    "S7-11 P000 is taken, but not stored": "P000 := 5; P000 = 0",
    "S7-11 P200 and P215 cannot be reached": "P200 refused 2; P215 := 0 refused 2",
    "S7-12 other functions get exception 1": "R2 refused 1",
    "W-09 an exception is the function with bit 7 and one code": """
        07 00 00 -> 87 01; 03 03 21 00 01 -> 83 02; 06 01 3A 03 E8 -> 86 03""",
    "X-01 (motor) the word that an SSW-06 ignores runs this one, in local mode too": """
        given P229=2 P220=0
        VB03 := 3; see motor.is_turned_on True""",
    "address, speed and framing are parameters": """
        join 19200 8E1; P312 = 6; listens 19200 8E1; P312 := 1; ignores 19200 8E1; P308 := 9; see address 9
        join 115200 8N1; listens 115200 8N1""",
    "S7-13 it says who it is": """
        given model='SSW-07 45.0A'
        2B 0E 01 00 -> 2B 0E 01 51 00 00 03 00 'WEG' 01 'SSW-07 45.0A' 02 'V1.40'""",
    "S7-13 an SSW-08 says so": """
        given model='SSW-08 17A'
        2B 0E 01 00 -> 2B 0E 01 51 00 00 03 00 'WEG' 01 'SSW-08 17.0A' 02 'V1.40'""",
    "S7-13 it says so from an object on, or of one alone; other objects and codes are refused": """
        2B 0E 01 01 -> 2B 0E 01 51 00 00 02 01 'SSW-07 85.0A' 02 'V1.40'
        2B 0E 01 09 -> 2B 0E 01 51 00 00 03 00 'WEG' 01 'SSW-07 85.0A' 02 'V1.40'
        2B 0E 04 02 -> 2B 0E 04 51 00 00 01 02 'V1.40'; 2B 0E 04 09 -> AB 02; 2B 0E 02 00 -> AB 03""",
    "S7-14 out of range is exception 3": "P313 := 4 refused 3; coil 0 := 1 refused 3",
    "S7-14 read-only is exception 3": "P003 := 0 refused 3; VB01 := 0 refused 3; P630 := 0 refused 3",
    "S7-14 what does not exist is exception 2": """
        P089 := 0 refused 2; coil 50 := 1 refused 2; P089 refused 2; P003 x3 refused 2; VB00 refused 2
        coil 15 x2 refused 2""",
    "a refused write of several registers changes nothing": "P313 := 2 2000 refused 3; P313 = 1 0",
    "C with the option running stays on during the ramp down": """
        given is_running_while_stopping=True
        run; stop; VB01 & 81h = 81h""",
    "C with a run command in force a reset starts the motor": """
        given keeps_run_command=True
        run; trip 5; 10 s; coil 107 := 1; VB01 & 1h = 1; see starts 0.0""",
    "C with a run command in force general enable starts the motor": """
        given keeps_run_command=True
        run; coil 101 := 0; see motor.state coasting; 10 s; coil 101 := 1; VB01 & 1h = 1""",
    "P220 = 5 is local after switching on": "given P220=5; VB01 & 100h = 0",
    "the keypad starts and stops in local control only": """
        keypad start; see motor.state stopped; control local; keypad start; VB01 & 1h = 1
        keypad stop; see motor.state ramp_down""",
    "an enable input that opens lets the motor coast": """
        run; do set_enable_input is_on=False; see motor.state coasting; VB01 & 2h = 0; P006 = 12
        do set_enable_input is_on=True; VB01 & 2h = 2""",
    "without mains the status says so and nothing starts": """
        run; mains off; 10 s; start; VB01 & 4001h = 0; see motor.state stopped""",
    "without control supply it is silent until it has started up": """
        given P313=1 P314=20
        run; power off; 100 s; VB01 silent; power on; 1 s; VB01 silent; 1.1 s; VB01 = 4102h; trips -""",
    "an overload is E05, a blocked rotor E66": """
        run; load 160; 1200 s; P014 = 5; P006 = 2; clear; thermal 0; start; 10 s; load 400; 3 s; P014 = 66""",
}


@pytest.mark.parametrize(("family", "script"), rules("ssw07", RULES))
def test_the_ssw07_keeps_the_rules_of_its_manual(family: str, script: str) -> None:
    play(family, script)

"""The simulated SSW900 against the rules of its manual (S9-xx, W-xx)."""

from __future__ import annotations

import pytest

from tests.sim.script import play, rules

# 680 status, 679 state, 685 and 686 command words of slots 1 and 2, 220 C3.1, 229 C3.2, 230 C3.3, 90 fault,
# 91-95 alarms, 734 C8.2.5.3, 735 S5.4.1, 740 C8.2.5.1, 741 C8.2.5.2, 1110 C11.3.1: signed, 32 bits
RULES = {
    "as delivered the word is 0012h and the slot commands in remote": """
        685 = 12h; 680 = 102h; 232 = 9; 679 = 0""",
    "a start goes through delay and initial test to ramp and bypass": """
        start; 680 = 1102h; 679 = 11; 0.6 s; 680 = 10Ah; 679 = 1; 0.2 s; 680 = 113h; 679 = 3
        10 s; 680 = 163h; 679 = 5; see starts 0.0""",
    "a stop ramps down and waits out the time after a stop": """
        run; stop; 680 = 182h; 679 = 7; 5 s; 680 = 2102h; 679 = 12; 2 s; 680 = 102h; 679 = 0""",
    "a stop before the ramp calls the start off": "start; 0.3 s; stop; 5 s; see motor.counters.starts 0",
    "(motor) a start during the time after a stop is ignored": """
        run; stop; 4.5 s; start; 5 s; see motor.state stopped; see starts 0.0""",
    "S9-07 (motor) without a mask a bare reset stops and disables": """
        run; 685 := 80h; see motor.is_turned_on False; see is_remote False""",
    "S9-07, W-13 (motor) reset acts on 0 to 1 and only on a fault": """
        685 := 92h; trip 66; 685 := 92h; see is_fault True; 685 := 12h; 685 := 92h; see is_fault False""",
    "S9-07 (motor) reserved bits do nothing": "685 := FF72h; see is_started False; 685 = 12h",
    "S9-07 (motor) jog and direction": """
        685 := 1Eh; 680 & 804h = 804h; 679 = 10; 685 := 1Ah; see motor.state coasting""",
    "a reversal shows in status and state": """
        run; 685 := 1Bh; 680 & 400h = 400h; 679 = 9; 10 s; see is_reverse True""",
    "S9-08 (motor) run and jog of an inactive source are cleared": """
        given P230=1
        685 := 17h; 685 = 12h; see is_started False; see start_frames 0.0; see starts""",
    "S9-08 (motor) a start bit for the other slot is hidden": """
        given slot=1
        686 := 13h; 686 = 12h; see is_started False""",
    "S9-06, S9-21 with the accessory in slot 2 its own word commands": """
        given slot=2
        335 = 0 2; 232 = 11; 685 := 13h; see is_started False; 686 := 13h; see is_started True""",
    "W-12 (motor) the source follows menu C3": """
        220 := 0; see is_remote False; 232 = 0; start; see is_started False
        229 := 4; start; see is_started True""",
    "bit 4 does not switch the mode where C3.1 names no slot": "given P220=3; 685 := 2; see is_remote True",
    "bit 4 switches the mode where C3.1 names the slot": "685 := 2; see is_remote False",
    "a reset needs no command source": "given P230=1; trip 5; 685 := 92h; see is_fault False",
    "a fault calls a start off and clears the run bit": """
        start; trip 5; 685 = 12h; 685 := 92h; 5 s; see motor.counters.starts 0""",
    "C with a run command in force a reset starts the motor": """
        given keeps_run_command=True
        run; trip 5; 20 s; 685 = 13h; 685 := 93h; 1 s; 680 & 1h = 1""",
    "(motor) a word that goes local and stops stops the motor": "run; 685 := 2; see motor.state ramp_down",
    "with a braking method a stop brakes for its time": """
        given P500=3 P501=5
        run; 20 s; stop; 680 & 281h = 200h; 679 = 8; 5.1 s; 680 & 281h = 0; see motor.state stopped
        500 := 0; 10 s; run; 10 s; stop; 680 & 281h = 80h""",
    "S9-17 (motor) mode 0 does nothing": "given P734=50 P740=0; run; 100 s; trips -",
    "S9-17 (motor) mode 1 trips F128 and the motor coasts": """
        given P734=150 P740=1
        run; 6 s; trips F128@15.0; see motor.state coasting; 90 = 128; 735 = 2; 685 := 92h; 90 = 0
        735 = 1""",
    "S9-17 (motor) mode 2, action 0: A128 alone, gone with the first telegram": """
        given P734=150 P740=2 P741=0
        run; 6 s; trips A128@15.0; see alarms 128; see motor.state bypass; 680 & 4100h = 100h""",
    "S9-17 (motor) action 1 stops by ramp": """
        given P734=150 P740=2 P741=1
        run; 6 s; see motor.state ramp_down""",
    "S9-17 (motor) action 2 disables": "given P734=150 P740=2 P741=2; run; 6 s; see motor.state coasting",
    "S9-17 (motor) action 3 changes to local": """
        given P734=150 P740=2 P741=3
        run; 6 s; see motor.state bypass; see is_remote False""",
    "S9-17 (motor) action 4 changes to remote": """
        given P734=150 P740=2 P741=4
        685 := 2; see is_remote False; 16 s; see is_remote True""",
    "S9-18 the time counts from the first valid telegram": """
        given P734=50 P740=1
        100 s; trips -; 680 = 102h; 5.1 s; trips F128@105.0""",
    "S9-20 counters of telegrams, CRC errors and bytes": """
        680 = 102h; 680 = 102h; 680 = 102h; do note_reception_error is_crc=True byte_count=8
        do note_reception_error is_crc=False byte_count=5; 736 = 4 3 1 5""",
    "S9-22 outputs follow their words when set to communication": """
        given P275=12 P251=9
        695 := 7; 696 := 1023; 678 = 1; 673 = 10000 20000 10000 1023""",
    "S9-22 an output with another function stays": "696 := 1023; 676 = 0",
    "S9-25 faults and alarms are numbered": """
        alarm A005; alarm A066; trip 66; 90 = 66 5 66 0 0 0; 680 & C000h = C000h; 679 = 2
        do set_alarm 5 is_on=False; do reset_at_keypad; 90 = 0 66 0 0 0 0""",
    "general disable is state 13": "do set_enable_input is_on=False; 679 = 13",
    "the keys of the HMI command when C3 names them": """
        given P230=0
        keypad start; see is_started True; 0.8 s; keypad stop; see motor.state ramp_down""",
    "the model is shown by its range of currents": "given model='412A'; 294 = 3",
    "S9-01 coils are for SoftPLC markers only": """
        coil 0 refused 2; DI0 refused 2; coil 0 := 1 refused 2; coil 0 := 1 1 refused 2; IR680 refused 1""",
    "S9-01 markers of the SoftPLC are coils and discrete inputs": """
        given coils={10:False,11:True,12:False} discrete_inputs={5:True,6:False,7:True}
        DI5 = 1 0 1; DI7 x2 refused 2; DI10 refused 2; coil 10 := 1; coil 11 := 0 1; coil 10 = 1 0 1
        coil 5 := 1 refused 2""",
    "S9-02 in a long read registers that are no parameter read 0": "18 = 1 0 0; 2000 = 0 0 0",
    "S9-02 in a short read they get exception 2": "19 refused 2; 18 x2 refused 2",
    "S9-03 in a long write what cannot be written is passed over": "229 := 4 3 1 77; 229 = 4 3 1",
    "S9-03 in a short write it gets exception 2": """
        680 := 1 refused 2; 19 := 1 refused 2; 231 := 0 0 refused 2""",
    "S9-04 a part of a longer type gets exception 2": """
        24 refused 2; 25 x2 refused 2; 22 x3 refused 2; 1110 := 0 refused 2; 1111 := 0 0 0 refused 2""",
    "S9-05 the low word comes first": """
        given serial_number=1193046
        298 = 3456h 12h; 1110 := FFFFh FFFFh; 1110 = FFFFh FFFFh""",
    "S9-09 stopped parameters do not change while the motor turns": """
        run; 1300 := 680; 1300 = 0; 899 := 5; 899 = 5""",
    "S9-20 the counters are cyclic": "736 = 1; let received 0x1FFFF; 736 = 0",
    "W-09 an exception is the function with bit 7 and one code": "03 27 0F 00 01 -> 83 02",
    "it has functions 22, here bit 0 of word 685, and 43": """
        2B 0E 01 00 -> 2B 0E 01 81 00 00 03 00 'WEG' 01 'SSW900' 02 'V1.20'
        see start_frames; 16 02 AD FF FE 00 01 -> 16 02 AD FF FE 00 01; see start_frames 0.0""",
    "address, speed and framing are parameters": """
        join 57600 8N1; 731 = 1 3; listens 57600 8N1; 732 := 0; ignores 57600 8N1; 731 := 9; see address 9
        join 115200 8N1; listens 115200 8N1""",
    "S9-23 a value out of range gets exception 3": """
        229 := 6 refused 3; 931 := 4 refused 3; 229 := 9 0 0 refused 3; 229 = 0
        1110 := 8000h FFFFh refused 3; 730 := 1 refused 3; 263 := 13 refused 3; 1500 := 1 refused 2""",
}
A128_WITHOUT_EFFECT = {
    f"S9-19 (motor) action {action} has no effect while C3.3 is {source}": f"""
        given P220={int(action == 3)} P229={source} P230={source} P734=150 P740=2 P741={action}
        {"686 := 3" if source else "keypad start"}; see is_started True; 680 & 8000h = 0; 16 s
        see motor.is_turned_on True; see is_remote {action == 3}; trips A128@15.0"""
    for action in (1, 2, 3, 4)
    for source in (0, 5)  # the keys of the HMI, slot 2
}


@pytest.mark.parametrize(("family", "script"), rules("ssw900", RULES | A128_WITHOUT_EFFECT))
def test_the_ssw900_keeps_the_rules_of_its_manual(family: str, script: str) -> None:
    play(family, script)

"""The closed list of reasons for which a command cannot be carried out as asked.

A violated rule of `interlock.RULES` is a reason too, and its name is the code then.
"""

from __future__ import annotations

from gateway.errors import CommandError

REFUSALS: dict[str, str] = {
    "unknown_verb": "this family has no such verb",
    "bad_arguments": "the arguments are not those of the verb",
    "unknown_parameter": "the manual of this family names no such parameter",
    "not_readable": "the parameter cannot be read over the serial line",
    "not_writable": "the parameter cannot be set",
    "out_of_range": "the value is outside the range of the manual",
    "bad_value": "the value is not of the parameter's kind",
    "not_in_firmware": "the firmware of this starter does not know it",
    "not_set_to_serial": "the starter is not set up to take this from the serial line",
    "not_in_that_mode": "the starter is not in that adjusting mode",
    "would_cut_connection": "the change would cut the connection to the starter",
    "motor_running": "the motor is not seen to stand",
    "capacitor_charged": "the start capacitor is charged, and the motor would start late",
    "timeout_unset": "a communication timeout of 0.0 s must not be made active",
    "slot_unknown": "it is not known which slot holds the RS-485 accessory",
    "word_unknown": "what is in force in the starter is not known",
}


def refused(code: str, detail: str) -> CommandError:
    """Return the error for a code of the closed list; `detail` names what this command got wrong."""
    return CommandError(code, f"{REFUSALS[code]}: {detail}")

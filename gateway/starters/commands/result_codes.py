"""The closed list of result codes: what an operator should read, and what to do.

The codes of `families.profile.procedure` and the rules of `families.command.interlock` are in it too. A
result's own `text` says more: the reading, the value, the starter. `docs/results.md` is made from this.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Code(NamedTuple):
    """What one code means, for people."""

    sentence: str
    hint: str


def explain(code: str) -> Code:
    """Return what a code means, also one that is not in the list."""
    for codes in CODES.values():
        if code in codes:
            return codes[code]
    return Code(
        "The starter refused with a Modbus exception that its manual does not name.", "See its manual."
    )


UNFIT = frozenset(  # of what is refused however often it comes: its id is free for a fit command
    {
        "bad_json",
        "bad_payload",
        "before_connection",
        "expired",
        "malformed_topic",
        "no_id",
        "retained",
        "too_big",
        "unknown_verb",
    }
)

_AGAIN = "Send it again, with a new id."
_LOOK = "Look at the starter, then decide."
_LATER = "Wait, look, then send it again, with a new id."
_SENDER = "Correct the program that sent it."

CODES: Mapping[str, Mapping[str, Code]] = {
    "It went well": {
        "ok": Code("Done, and read back from the starter; or the phase is on its way.", "Nothing."),
        "unchanged": Code("The starter held this value already; nothing was written.", "Nothing."),
    },
    "It is not known what the motor does": {
        "not_seen": Code(
            "It was written, but the starter was not seen to do it in time. The motor may be turning.", _LOOK
        ),
        "not_followed": Code(
            "What was written does not read back: the output or the parameter did not follow. Nothing moves.",
            "See what the text names: the output's function, the parameter's range.",
        ),
        "run_not_cleared": Code(
            "The starter did not take run = 0, so that an earlier run command could have started the motor. "
            "Nothing else was written.",
            "Do it at the starter, where the motor can be watched.",
        ),
        "not_readable": Code(
            "It was written, but cannot be read back; or the parameter cannot be read at all.", _LOOK
        ),
        "crashed": Code(
            "The gateway ended while the command was under way. When unconfirmed, the motor may be turning; "
            "when rejected, nothing was written.",
            f"{_LOOK} It is never carried out again by itself.",
        ),
        "not_all": Code(
            "Not every starter of the group was seen to stop.", "See the results of the members."
        ),
        "no_answer": Code(
            "The starter did not answer. When unconfirmed, a write before may have acted.",
            "Look at the starter and its line.",
        ),
        "line_down": Code(
            "The line is away: the command could not be sent.",
            "Look at the adapter; stop at the starter itself.",
        ),
        "stopped_first": Code(
            "A stop came first: it cut this command short, or came after this one was decided upon.",
            "Nothing, if the stop was meant; else decide again, and send a new token with a new id.",
        ),
        "internal": Code("An error inside the gateway.", f"{_LOOK} Report it, with the log."),
    },
    "The starter would not": {
        "illegal_function": Code(
            "The starter refused: it does not take this command now (the SST: another has control).",
            "See who controls the starter.",
        ),
        "illegal_data_address": Code(
            "The starter refused: it has no such parameter, or not now.", "See its model and firmware."
        ),
        "illegal_data_value": Code(
            "The starter refused the value, or the command is not set to serial.", "See the manual's range."
        ),
        "server_device_failure": Code("The starter failed while it carried the command out.", _LOOK),
        "acknowledge": Code("The starter took the command and is still at it.", _LOOK),
        "server_device_busy": Code("The starter is busy.", _AGAIN),
        "memory_parity_error": Code("The starter's memory is faulty.", "Have the starter looked after."),
        "gateway_path_unavailable": Code("A Modbus gateway on the way has no path.", "Look at that gateway."),
        "gateway_target_device_failed_to_respond": Code(
            "Behind a Modbus gateway on the way, the starter is silent.", "Look at the line behind it."
        ),
    },
    "The starter is not in a state for it": {
        "in_local": Code("The starter is in local mode.", "Switch it to remote."),
        "controlled_elsewhere": Code(
            "USB or the parallel input controls the starter.", "Give control back to serial."
        ),
        "not_enabled": Code("The starter is not generally enabled.", "general_enable, or its input."),
        "fault_active": Code("A fault is active.", "Find its cause, then reset."),
        "no_fault_to_reset": Code("There is no fault to reset.", "Nothing."),
        "not_ready": Code("The starter is not ready for a start.", "See its state and alarms."),
        "not_configured": Code("The SST's configuration is not complete.", "Send configure first."),
        "motor_running": Code("The motor is not stopped.", "Stop it first."),
        "no_power": Code("The power section has no supply.", "Switch it on."),
        "capacitor_charged": Code(
            "The start capacitor of the SST130i is charged: the motor would start late.",
            "Wait until it is discharged, then send the start again, with a new id.",
        ),
        "not_in_that_mode": Code("The starter is not in the mode that was to be left.", "See its state."),
        "not_set_to_serial": Code("The starter does not take this from the serial line.", "Set it up so."),
        "not_in_firmware": Code("This starter's firmware does not have it.", "See its firmware."),
        "readings_disagree": Code("No two readings in a row agreed.", "Look at the starter and its line."),
        "offline": Code("The starter does not answer.", "Look at the starter and its line."),
        "identity_unknown": Code("It is not yet known who answers at this address.", _LATER),
        "identity_mismatch": Code(
            "Another device answers than the one configured.", "Correct the wiring or the configuration."
        ),
        "identity_changed": Code(
            "Another starter answers than before, or another model than configured.", "Look, then accept."
        ),
        "no_start": Code("There is no start that could be the baseline.", "Start the motor, then again."),
        "history_unavailable": Code(
            "The history of earlier runs is still being read.", "Again, in a moment."
        ),
        "nothing_to_accept": Code("No change of the starter's identity waits to be accepted.", "Nothing."),
        "state_unknown": Code("The starter's state is not known now.", _LATER),
        "not_as_expected": Code("The starter is not as the command expects.", "Look, and decide again."),
        "state_changed": Code(
            "The state has changed since the starter was selected.", "Look, and select again."
        ),
        "slot_mismatch": Code(
            "The RS-485 accessory sits in another slot than configured; a stop goes to the right one.",
            "Correct `slot`, or leave it out.",
        ),
        "slot_unknown": Code("It is not known which slot holds the RS-485 accessory.", "Set `slot`."),
        "word_unknown": Code("Neither command nor status word of the starter is known.", _LATER),
    },
    "The site's rules forbid it": {
        "too_many_starts": Code("There were as many starts this hour as allowed.", "Wait as the text says."),
        "pause_too_short": Code("The motor has not stood still for long enough.", "Wait as the text says."),
        "feeder_busy": Code("Another motor of this feeder has just been started.", "Wait as the text says."),
        "locked": Code(
            "The starter is locked for maintenance. This replaces no physical lock.", "Ask who locked it."
        ),
        "not_locked": Code("The starter is not locked.", "Nothing."),
        "lock_removed": Code("Another client has removed your lock.", "Ask him before you touch the motor."),
        "select_first": Code("This starter takes two steps.", "select, then the verb with its token."),
        "not_selected": Code("The token selects nothing of yours.", "Select again."),
        "selection_expired": Code("The selection was longer ago than it is valid.", "Select again."),
        "selected_otherwise": Code("It was selected for another verb or other arguments.", "Select again."),
        "selected_by_other": Code("Another client has this starter selected.", "Wait, or ask him."),
        "busy": Code(
            "Another command for this starter is under way.",
            "Wait for its result, then send yours again, with a new id.",
        ),
        "too_many": Code(
            "Too many at once: commands, or reads and settings on one line. A stop is sent all the same.",
            "Send fewer.",
        ),
        "watchdog_unkept": Code(
            "The line cannot keep a starter from a watchdog that short.",
            "Set it as the text says, or longer.",
        ),
        "wear_limit": Code("So many writes would wear the starter's memory out.", "Wait as the text says."),
    },
    "The gateway would not": {
        "not_allowed": Code("This client has no right to it.", "See [[operator]] in the configuration."),
        "ledger_unavailable": Code(
            "The gateway cannot note commands on its disk, so it takes none but stop.", "Look at state_dir."
        ),
        "ledger_full": Code(
            "Of so many commands a copy could still be carried out that no new one can be remembered.",
            "Wait a minute. A stop is always taken.",
        ),
        "not_kept": Code("It could not be stored on the disk.", "Look at state_dir."),
        "shutting_down": Code("The gateway is ending.", f"{_LOOK} {_AGAIN}"),
        "interrupted": Code("Its client interrupted the command.", _LOOK),
    },
    "The command itself is wrong": {
        "retained": Code(
            "A retained command is never acted on, but for a live stop.", "Send it without retain."
        ),
        "expired": Code(
            "Its own time was over when it came, or before the line and the starter let it be written.",
            f"Look at what holds messages up, or at how full the line is. {_AGAIN}",
        ),
        "not_fresh": Code(
            "Nothing proves that it is fresh.",
            "Send the token of gateway/fresh, or issued_at by synchronised clocks: the text says which.",
        ),
        "wrong_boot": Code(
            "Its boot is not the present one.", "Read gateway/fresh, decide again, send its token."
        ),
        "before_connection": Code("It is older than the gateway's connection.", "Decide again, send again."),
        "malformed_topic": Code(
            "The topic is not command/STARTER/CLIENT/VERB in lower case; nothing was done.",
            "Send it to the right topic.",
        ),
        "no_id": Code("Every command but stop needs an id.", _SENDER),
        "id_reused": Code("This id stood for another command.", "Use a new id for each command."),
        "unknown_starter": Code("This gateway has no such starter.", "See gateway/info."),
        "unknown_verb": Code("This starter has no such verb.", "See `commands` in its info."),
        "group_only_stop": Code("A group can only be stopped.", "Command its members."),
        "bad_arguments": Code("The arguments are not those of the verb.", _SENDER),
        "bad_expect": Code("`expect` names what this starter does not have.", _SENDER),
        "bad_json": Code("The payload is not JSON.", _SENDER),
        "bad_payload": Code("A field is unknown, missing or not of its kind.", _SENDER),
        "too_big": Code("The payload has more than 4 KB.", _SENDER),
        "unknown_parameter": Code("The manual names no such parameter.", "See the family's manual."),
        "not_writable": Code("The parameter cannot be set.", "See the family's manual."),
        "out_of_range": Code("The value is outside the manual's range.", "See the family's manual."),
        "bad_value": Code("The value is not of the parameter's kind.", "See the family's manual."),
        "would_cut_connection": Code("It would cut the connection to the starter.", "Do it at the starter."),
        "timeout_unset": Code("A communication timeout of 0 s must not be made active.", "Set a time first."),
    },
}

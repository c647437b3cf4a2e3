"""The closed list of event codes: what happened, what to do, and what `data` holds.

An event's own `text` says more: the reading, the address, the cause. `docs/reference/events.md` is made from
this, and a test compares it with what the program publishes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from gateway.contract import Severity

INFO, WARNING, ERROR = Severity.INFO, Severity.WARNING, Severity.ERROR


class Event(NamedTuple):
    """What one code means, for people; `fields` are the keys of `data` that may be there."""

    severities: tuple[Severity, ...]
    sentence: str
    hint: str
    fields: Mapping[str, str] = {}


_NOTHING = "Nothing."
_DISK = "Look at the disk of state_dir: space, permissions, read-only mount."
_CABLE = "Look at the cable, the shield, the reference and the termination."
_BOX = "Look at the load of this machine."

_LINE = {"line": "the line"}
_BUS = {
    **_LINE,
    "unit": "the address; 0: an unknown one",
    "frames": "the last frames on the line, hexadecimal, the oldest first",
}
_CHANGE = {"from": "the state before", "to": "the state now"}
_RUN = {"run_s": "how long the motor was on, s; only after a start that was seen"}
_BEFORE = {"before": "a list of {seconds_before, values}: the points that were good, the oldest first"}
_ALARM = {
    "alarm": "code of the fault or alarm, in lower case as in its topic",
    "severity": "fault or alarm",
    "count": "how often it came since the gateway's start",
}
_DRIFT = {
    "start": "id of the start",
    "drift": "by quantity: {baseline, median, change_pct}",
}
_LOCK = {
    "client": "the client of the command",
    "operator": "who that client says it acts for, a claim",
    "reason": "why, in the operator's words",
}
_IDENTITY = {
    "known": "the device that was known: family, model, serial, firmware and what else it says",
    "seen": "the device that answers now, the same fields",
    "configured_model": "the configured model that it contradicts, else null",
}

EVENTS: Mapping[str, Mapping[str, Event]] = {
    "Motors": {
        "started": Event(
            (INFO,),
            "The motor was started: from remote, from local, or at the starter.",
            _NOTHING,
            {**_CHANGE, **_BEFORE},
        ),
        "stopped": Event((INFO,), "The motor has stopped.", _NOTHING, {**_CHANGE, **_RUN, **_BEFORE}),
        "fault": Event(
            (ERROR,),
            "The starter has a fault; `before` holds the values of the seconds before it.",
            "Read the alarms of the starter, find the cause, then reset.",
            {
                **_CHANGE,
                **_RUN,
                "alarm": "code of the first fault, in lower case as in its topic",
                "severity": "fault",
                "faults": "a list of {code, text, count}: all that came together",
                **_BEFORE,
            },
        ),
        "alarm": Event(
            (WARNING, ERROR), "An alarm has come, or a further fault.", "See the family's page.", _ALARM
        ),
        "cleared": Event((INFO,), "A fault or alarm has gone.", _NOTHING, _ALARM),
        "start_drift": Event(
            (WARNING,),
            "The motor starts otherwise than at its baseline.",
            "Look at load, bearings, belt and supply; see the starts' records.",
            _DRIFT,
        ),
        "start_drift_over": Event((INFO,), "The motor starts as at its baseline again.", _NOTHING, _DRIFT),
        "one_start_left": Event(
            (WARNING,),
            "One start is left in this hour.",
            "Let the motor rest before the start after it.",
        ),
        "local_operation": Event(
            (INFO,),
            "The starter was switched to local: commands but stop are refused.",
            "Switch it to remote when the work at the motor is done.",
        ),
        "remote_operation": Event((INFO,), "The starter takes commands from remote again.", _NOTHING),
    },
    "Commands": {
        "stop_unconfirmed": Event(
            (ERROR,),
            "A stop was not seen to act: the motor may be turning.",
            "Go and look; stop at the starter itself.",
            {"phase": "the final phase of the stop", "code": "its result code"},
        ),
        "command_cut_short": Event(
            (ERROR,),
            "The gateway ended while a command was under way: the motor may be turning.",
            "Look at the starter; the command is not repeated.",
            {"client": "its client", "id": "its id", "verb": "its verb"},
        ),
        "locked": Event((INFO,), "The starter is locked for maintenance.", _NOTHING, _LOCK),
        "unlocked": Event(
            (INFO, WARNING),
            "The maintenance lock was removed; a warning when another client had set it.",
            "When it was your lock: ask before you touch the motor.",
            {**_LOCK, "lock": "the lock that was removed: by, operator, reason"},
        ),
        "malformed_topic": Event(
            (WARNING,),
            "A message came on a command topic that names no command.",
            "Correct the program that sent it.",
            {
                "problem": "what is wrong, in a word",
                "topic": "the topic, shortened",
                "count": "messages since the last such event",
            },
        ),
        "memory_written": Event(
            (INFO,),
            "The starter's non-volatile memory was written often.",
            "See which program sets parameters again and again.",
            {"last_hour": "writes in the last 60 minutes", "total": "writes since the count began"},
        ),
    },
    "Whether a starter answers, and which one": {
        "went_silent": Event(
            (WARNING,),
            "The starter does not answer any more; its values are stale.",
            "Look at its supply, its cable and its address.",
            {"reason": "what came instead of a reply", "frames": _BUS["frames"]},
        ),
        "answers_again": Event((INFO,), "The starter answers again.", _NOTHING),
        "degraded": Event(
            (WARNING,),
            "A part of the starter cannot be read.",
            "Do as the text says; mostly the model or firmware lacks what is asked.",
            {"topic": "which part, in a word"},
        ),
        "recovered": Event((INFO,), "The starter can be read whole again.", _NOTHING),
        "identity_mismatch": Event(
            (ERROR,),
            "A device of another family answers; commands but stop are held.",
            "Correct the wiring, the address or the configuration.",
            {"expected": "the configured family", "seen": "the family that answers", "model": "its model"},
        ),
        "identity_unknown": Event(
            (WARNING,),
            "It is not known which device answers; commands but stop are held.",
            "Do as the text says; it is asked again by itself.",
        ),
        "identity_changed": Event(
            (ERROR,),
            "Another device answers than before, or another model than configured; commands are held.",
            "Look at the device, then send `accept`, or correct the configuration.",
            _IDENTITY,
        ),
        "slot_mismatch": Event(
            (ERROR,),
            "The RS-485 accessory of an SSW900 sits in another slot than configured; "
            "commands but stop and read are held.",
            "Correct `slot`, or leave it out.",
            {"configured": "the configured slot", "seen": "where the accessory sits"},
        ),
        "identity_accepted": Event((INFO,), "The device that answers was accepted.", _NOTHING, _IDENTITY),
    },
    "Settings of a starter": {
        "readiness": Event(
            (INFO, WARNING, ERROR),
            "What in the starter's settings keeps it from remote operation, or makes it trip.",
            "Do as each finding says, at the keypad.",
            {
                "would_refuse_start": "whether a start would be refused now",
                "findings": "a list: what was found, how grave it is and the remedy",
                "watchdogs": "a list of {parameter, after_s, does}: its communication timeouts, s",
            },
        ),
        "parameter_changed": Event(
            (WARNING,),
            "A setting was changed, and not through this gateway.",
            "Compare it with the saved set: `parameters diff`.",
            {
                "parameter": "its code in the manual",
                "name": "its name",
                "before": "the value before: value, unit, label, raw words",
                "after": "the value now, the same fields",
            },
        ),
    },
    "Lines": {
        "port_open": Event((INFO,), "The port is open.", _NOTHING, _LINE),
        "port_away": Event(
            (ERROR,),
            "The port cannot be opened, or was lost; it is tried again.",
            "Look at the adapter, its name below /dev and its permissions: `doctor`.",
            _LINE,
        ),
        "port_deaf": Event(
            (ERROR,),
            "The port is open, but no starter answers; it is opened again.",
            "Look at the adapter, the cable, rate and byte format.",
            _LINE,
        ),
        "address_conflict": Event(
            (ERROR,), "Two devices answer at one address.", "Give one of them another address.", _BUS
        ),
        "babbling": Event(
            (ERROR,), "A device sends without being asked.", "Find the second master, or the defect.", _BUS
        ),
        "line_noise": Event((ERROR,), "Replies of several starters are corrupted.", _CABLE, _BUS),
        "cable": Event(
            (INFO, WARNING), "The errors on the line point to a place of its cable, or no longer.", _CABLE
        ),
        "line_saturated": Event(
            (WARNING,),
            "The line has no time to spare; values come late.",
            "Raise every_s, raise the rate, or split the line: `check` computes it.",
        ),
        "line_relieved": Event((INFO,), "The line has time to spare again.", _NOTHING),
        "watchdog_unkept": Event(
            (ERROR,),
            "A starter was left longer than its communication watchdog allows: it may have acted.",
            "Set the watchdogs longer, or take load off the line.",
        ),
    },
    "Broker": {
        "broker_connected": Event((INFO,), "The gateway is connected to the broker.", _NOTHING),
        "broker_away": Event(
            (WARNING,),
            "The connection to the broker is lost; what must not be lost waits on the disk.",
            "Look at the broker and the network: `doctor`.",
        ),
        "client_id_taken": Event(
            (ERROR,),
            "Another client uses this gateway's client id.",
            "Stop it, or give one of the two another name.",
        ),
        "base_shared": Event(
            (ERROR,),
            "Another gateway, with another client id, publishes below this gateway's base.",
            "Stop it, or give one of the two another name in [gateway] or another base in [mqtt].",
            {"base": "the base"},
        ),
        "leftovers_unread": Event(
            (WARNING,),
            "The broker does not let the gateway read what earlier runs left retained: none is cleared.",
            "Correct its access list: `starter-gateway broker-kit` writes a right one.",
            {"topics": "the topics that it may not read"},
        ),
        "message_too_large": Event(
            (ERROR,),
            "The broker sent a packet that is not read, or announced one too large even to be read over.",
            "Find who sends it; clear it if it is retained.",
        ),
        "mqtt_3_1_1": Event(
            (WARNING,),
            "MQTT 3.1.1 is used: the broker refuses MQTT 5, or `mqtt.version` says so.",
            "Use a broker with MQTT 5: else retained commands cannot be distinguished.",
        ),
        "mqtt_5": Event((INFO,), "The broker takes MQTT 5 again.", _NOTHING),
        "publish_refused": Event(
            (ERROR,),
            "The broker refuses messages of the gateway.",
            "Correct its access list: `starter-gateway broker-kit` writes a right one.",
            {
                "count": "messages since the last such event",
                "topic": "the topic of the last",
                "reason_code": "MQTT's reason code of the last",
            },
        ),
        "gap": Event(
            (WARNING,),
            "Messages were lost before the broker had them.",
            "Expect a hole in what was recorded in that time.",
            {
                "count": "messages",
                "first": "time of the first",
                "last": "time of the last",
                "lost": "a list of {reason, kind, count, first, last}",
            },
        ),
    },
    "Status page": {
        "web_open": Event(
            (INFO,), "The status page is served.", _NOTHING, {"url": "its address, for a browser"}
        ),
        "web_certificate": Event(
            (ERROR,),
            "The status page goes on with its certificate of before: the files cannot be used.",
            "Put a certificate and its key there, then reload.",
        ),
        "web_away": Event(
            (ERROR,),
            "The status page cannot be served.",
            "See the text: the address is in use, a certificate is wrong, or a package is missing.",
        ),
    },
    "Metrics": {
        "metrics_away": Event(
            (WARNING, ERROR),
            "The metrics' file cannot be written, or a package is missing.",
            "Do as the text says; scrapes of /metrics go on where the package is there.",
        ),
        "metrics_back": Event((INFO,), "The metrics' file is written again.", _NOTHING),
    },
    "Sparkplug": {
        "sparkplug_born": Event(
            (INFO,),
            "The edge node is connected and has published its birth.",
            _NOTHING,
            {"node": "group and node id"},
        ),
        "sparkplug_away": Event(
            (WARNING, ERROR),
            "The edge node is not connected, or waits for its primary host; an error: a package is missing.",
            "See the text: the server, the login, the access list, the primary host or the package.",
        ),
        "dcmd_refused": Event(
            (WARNING,),
            "DCMDs of a Sparkplug host were not read, or not to their end, or name no starter.",
            "Correct the host that sends them.",
            {
                "starter": "the starter, as the host names it",
                "code": "why: too_big, too_many, bad_payload, unknown_starter",
                "count": "DCMDs since the last such event",
            },
        ),
    },
    "Configuration": {
        "stopping": Event(
            (INFO, WARNING),
            "The gateway has been asked to end, or to restart; its lines still poll.",
            "With names in `too_short`: make those watchdogs longer before the next restart.",
            {
                "reason": "why",
                "gap_s": "the longest time without a request to a starter if it is started again at once, s",
                "starter": "the starter of that time",
                "too_short": "names: their watchdogs are shorter than a restart takes",
            },
        ),
        "reloaded": Event(
            (INFO,),
            "The new configuration is in force.",
            _NOTHING,
            {
                "lines_added": "names; each key is there only when it names something",
                "lines_reopened": "names: their port settings have changed",
                "lines_removed": "names",
                "starters_added": "names",
                "starters_changed": "names: they began anew",
                "starters_removed": "names",
                "starters_paced": "names: another every_s",
            },
        ),
        "reload_refused": Event(
            (ERROR,),
            "The new configuration is wrong; the old one stays in force.",
            "Correct what `mistakes` names, then reload.",
            {"mistakes": "a list of lines: key, what is wrong, remedy"},
        ),
        "reload_failed": Event(
            (ERROR,), "The reload was cut short by an error.", "Restart the gateway; report its log."
        ),
    },
    "Clock and processor": {
        "clock_trusted": Event(
            (INFO,), "The clock is synchronised: issued_at proves freshness again.", _NOTHING
        ),
        "clock_stepped": Event(
            (WARNING,),
            "The clock was set: issued_at proves nothing for now.",
            "Send the token of gateway/fresh; look at the time service.",
        ),
        "stood_still": Event(
            (WARNING,),
            "The machine stood still, or its clock was set ahead: what was sent before is refused.",
            "Do not suspend this machine.",
        ),
        "lag": Event((ERROR,), "The program was so late that watchdogs may act.", _BOX),
    },
    "Disk": {
        "ledger_unavailable": Event(
            (WARNING, ERROR), "Commands cannot be stored: none but stop is taken.", _DISK
        ),
        "ledger_available": Event((INFO,), "Commands are stored again.", _NOTHING),
        "ledger_slow": Event((WARNING, ERROR), "The disk takes long to store a command.", _DISK),
        "ledger_lost": Event(
            (WARNING, ERROR),
            "The stored commands were damaged and set aside.",
            "Copies of earlier commands are not recognised: send none again.",
        ),
        "audit_unavailable": Event((WARNING, ERROR), "The audit cannot be written.", _DISK),
        "audit_available": Event((INFO,), "The audit is written again.", _NOTHING),
        "outbox_unavailable": Event((ERROR,), "What waits for the broker is in memory only.", _DISK),
        "outbox_available": Event((INFO,), "What waits for the broker is on the disk again.", _NOTHING),
        "outbox_lost": Event(
            (ERROR,), "What waited for the broker on the disk was lost.", f"{_DISK} See `gap`."
        ),
        "history_unavailable": Event((WARNING,), "Starts, trips and counters cannot be stored.", _DISK),
        "history_available": Event((INFO,), "Starts, trips and counters are stored again.", _NOTHING),
        "history_lost": Event(
            (WARNING,), "The motors' history was damaged and set aside.", "Set the baselines anew."
        ),
        "memory_away": Event((WARNING, ERROR), "Locks, starts or watchdogs cannot be stored.", _DISK),
        "memory_back": Event((INFO,), "Locks, starts or watchdogs are stored again.", _NOTHING),
        "memory_damaged": Event(
            (WARNING, ERROR),
            "A file of state_dir was damaged and set aside; starters that may have been locked are locked.",
            "Look at the starters, then unlock; look at the disk.",
        ),
        "identities_away": Event((WARNING,), "The starters' fingerprints cannot be stored.", _DISK),
        "identities_back": Event((INFO,), "The starters' fingerprints are stored again.", _NOTHING),
    },
}

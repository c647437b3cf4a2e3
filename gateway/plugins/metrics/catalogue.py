"""Every metric: its name, type, labels and meaning; pure. docs/metrics.md is made from this.

Base units, in the plural, stand in the names; counters end in `_total`; an instant is a `_timestamp_seconds`
(Prometheus, "Metric and label naming").
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

PREFIX = "starter_gateway_"
STARTER = ("line", "starter")

Kind = Literal["gauge", "counter", "histogram", "summary"]


class MetricSpec(NamedTuple):
    """One metric; `labels` without those that its type adds (`le`, `quantile`)."""

    kind: Kind
    labels: tuple[str, ...]
    help: str


class MotorPoint(NamedTuple):
    """A point with a metric of its own, and by what its values are multiplied to be in that unit."""

    metric: str
    help: str
    factors: Mapping[str, float]  # by the point's unit


MOTOR_POINTS: Mapping[str, MotorPoint] = {
    "current": MotorPoint("motor_current_amperes", "Motor current.", {"A": 1.0}),
    "line_voltage": MotorPoint("motor_line_voltage_volts", "Line voltage.", {"V": 1.0}),
    "active_power": MotorPoint("motor_active_power_watts", "Active power.", {"W": 1.0, "kW": 1000.0}),
    "power_factor": MotorPoint("motor_power_factor_ratio", "Power factor, 0 to 1.", {"": 1.0, "%": 0.01}),
    "heatsink_temperature": MotorPoint("motor_heatsink_celsius", "Heatsink temperature.", {"°C": 1.0}),
    "line_frequency": MotorPoint("motor_frequency_hertz", "Frequency of the supply.", {"Hz": 1.0}),
}

METRICS: Mapping[str, Mapping[str, MetricSpec]] = {
    "Gateway": {
        "build_info": MetricSpec("gauge", ("gateway", "version", "contract"), "Always 1; what runs here."),
        "start_timestamp_seconds": MetricSpec("gauge", (), "When this run of the gateway began."),
        "clock_synchronised": MetricSpec("gauge", (), "1 while the system clock is trusted."),
        "loop_lag_seconds": MetricSpec(
            "histogram",
            ("loop",),
            "How late a loop was when its timers ran out: lines (all lines), gateway (everything else).",
        ),
        "web_streams": MetricSpec("gauge", (), "Open status pages."),
    },
    "Broker": {
        "broker_connected": MetricSpec("gauge", (), "1 while connected to the broker."),
        "broker_reconnects_total": MetricSpec("counter", (), "Connections to the broker after the first."),
        "outbox_messages": MetricSpec("gauge", (), "Messages that the broker has not acknowledged."),
        "outbox_bytes": MetricSpec("gauge", (), "Their size."),
        "outbox_oldest_timestamp_seconds": MetricSpec(
            "gauge", (), "Since when the oldest of them waits; absent while none waits."
        ),
        "outbox_dropped_total": MetricSpec("counter", (), "Messages that were lost: the outbox was full."),
        "outbox_refused_total": MetricSpec("counter", (), "Messages that the broker has refused."),
    },
    "Lines": {
        "line_open": MetricSpec("gauge", ("line",), "1 while the port is open."),
        "line_utilisation_ratio": MetricSpec("gauge", ("line",), "Share of time that the line is busy."),
        "line_sweep_seconds": MetricSpec("gauge", ("line",), "Time for one request of each poll."),
        "line_stop_latency_bound_seconds": MetricSpec(
            "gauge", ("line",), "How long a stop waits for its first byte at most, as computed."
        ),
        "line_stop_latency_worst_seconds": MetricSpec(
            "gauge", ("line",), "The longest that a stop has waited; absent before the first stop."
        ),
        "stop_latency_seconds": MetricSpec(
            "histogram", ("line",), "How long each stop has waited for its first byte."
        ),
        "polls_total": MetricSpec(
            "counter",
            ("line", "outcome"),
            "Requests on the line, those of commands too, by outcome: answered, silent, garbled, refused.",
        ),
    },
    "Starters": {
        "starter_info": MetricSpec(
            "gauge", (*STARTER, "family", "model", "firmware"), "Always 1; what the starter is."
        ),
        "starter_online": MetricSpec(
            "gauge", STARTER, "1 while it answers; absent where enabled = false, as all that follows."
        ),
        "starter_last_reply_timestamp_seconds": MetricSpec(
            "gauge", STARTER, "When a value of it was last read, good or not."
        ),
        "starter_last_good_reading_timestamp_seconds": MetricSpec(
            "gauge", STARTER, "When a value of it was last good."
        ),
        "starter_state": MetricSpec("gauge", (*STARTER, "state"), "1 for the present state, 0 for others."),
        "starter_fault_active": MetricSpec("gauge", STARTER, "1 while it has a fault."),
        "starter_fault_code": MetricSpec(
            "gauge", STARTER, "The fault's number, while it has one and gives its number as a value."
        ),
        "starter_locked": MetricSpec("gauge", STARTER, "1 while it is locked for maintenance."),
        "starter_response_seconds": MetricSpec(
            "summary", STARTER, "From a request's end to the first byte of its reply; recent requests."
        ),
        "starter_polls_total": MetricSpec(
            "counter", (*STARTER, "outcome"), "Requests to the starter by outcome."
        ),
    },
    "Motors": {
        **{each.metric: MetricSpec("gauge", STARTER, each.help) for each in MOTOR_POINTS.values()},
        "point_value": MetricSpec(
            "gauge",
            (*STARTER, "point", "unit"),
            "Any other point that is a number or a boolean, in its own unit; by all_points or asked for.",
        ),
        "starts_total": MetricSpec("counter", STARTER, "Starts of the motor, however given."),
        "trips_total": MetricSpec(
            "counter", (*STARTER, "code"), "Trips by fault; from 0 on for each that the family names."
        ),
        "start_drifts_total": MetricSpec(
            "counter", STARTER, "How often the motor began to start otherwise than at its baseline."
        ),
    },
    "Commands": {
        "commands_total": MetricSpec(
            "counter", ("verb", "phase", "code"), "Phases that commands have gone through; not repetitions."
        ),
        "command_seconds": MetricSpec(
            "histogram", ("verb",), "From a command's acceptance to its final result."
        ),
        "commands_rejected_total": MetricSpec("counter", ("code",), "Refused commands by reason."),
        "commands_unconfirmed_total": MetricSpec(
            "counter", STARTER, "Commands that were written and not seen to act: the motor may be turning."
        ),
    },
}

SPECS: Mapping[str, MetricSpec] = {name: spec for group in METRICS.values() for name, spec in group.items()}

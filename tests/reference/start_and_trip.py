"""The payloads of a start and of a trip, as long as the contract has each as one mapping without fields."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NotRequired

from pydantic import Field
from typing_extensions import TypedDict  # pydantic needs its own before Python 3.12

from gateway.contract.records import Boot, PossibleTime, Seq
from gateway.plugins.history.start_record import StartOutcome, StartSource

Instant = Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")]
Column = NotRequired[Annotated[list[Any], Field(description="the point of this name")]]
Times = Annotated[list[float], Field(description="time from the event, s")]


class Cause(TypedDict):
    source: Annotated[StartSource, Field(description="where it came from")]
    client: NotRequired[Annotated[str, Field(description="of a command through the gateway")]]
    command_id: NotRequired[Annotated[str, Field(description="of a command through the gateway")]]


class Drift(TypedDict):
    baseline: Annotated[float, Field(description="at the baseline")]
    median: Annotated[float, Field(description="of the last starts")]
    change_pct: Annotated[float, Field(description="by how much it has changed, %")]


class Samples(TypedDict):
    t_s: Times
    current: Column
    line_voltage: Column
    output_voltage: Column
    torque_pct: Column
    power_factor: Column
    thermal: Column


class Start(TypedDict):
    id: Annotated[str, Field(description="names the start")]
    time: Annotated[Instant, Field(description="when the motor began to accelerate")]
    boot: Boot
    seq: Seq
    cause: Annotated[Cause, Field(description="who gave the start")]
    outcome: Annotated[StartOutcome, Field(description="its end; given_up: the gateway lost sight of it")]
    standstill_s: NotRequired[Annotated[float, Field(description="at rest before, as far as it was seen, s")]]
    rate_hz: NotRequired[Annotated[float, Field(description="samples of the current by their time, Hz")]]
    rated_a: NotRequired[Annotated[float, Field(description="rated current, A")]]
    acceleration_s: NotRequired[Annotated[float, Field(description="acceleration time, s")]]
    resolution_s: NotRequired[Annotated[float, Field(description="its uncertainty, plus or minus, s")]]
    peak_a: NotRequired[Annotated[float, Field(description="highest current, A")]]
    mean_a: NotRequired[Annotated[float, Field(description="mean current while it accelerated, A")]]
    i2t_a2s: NotRequired[Annotated[float, Field(description="integral of the squared current, A²s")]]
    i2t_error_pct: NotRequired[Annotated[float, Field(description="its uncertainty, plus or minus, %")]]
    lowest_v: NotRequired[Annotated[float, Field(description="lowest line voltage, V")]]
    heating_pct: NotRequired[Annotated[float, Field(description="rise of the thermal level, %")]]
    outliers: NotRequired[Annotated[int, Field(description="impossible readings of the current, left out")]]
    is_baseline: Annotated[bool, Field(description="whether later starts are compared with it")]
    drift: NotRequired[
        Annotated[Mapping[str, Drift], Field(description="the last starts and the baseline, by quantity")]
    ]
    samples: Annotated[
        Samples, Field(description="columns of the same length; null where a reply did not hold it")
    ]


class Readings(TypedDict):
    t_s: Times
    points: Annotated[Mapping[str, object], Field(description="columns of the same length, by point")]
    constant: Annotated[Mapping[str, object], Field(description="points that did not change, by point")]


class Trip(TypedDict):
    id: Annotated[str, Field(description="names the trip")]
    time: Annotated[PossibleTime, Field(description="the first reading that showed it")]
    boot: Boot
    seq: Seq
    code: Annotated[str, Field(description="code of the fault, in lower case; `fault`: it has no number")]
    text: Annotated[str, Field(description="its name in the manual")]
    state_before: Annotated[str | None, Field(description="null: found at the first reading")]
    readings: Annotated[Readings, Field(description="the readings before it")]
    at_fault: Annotated[
        Mapping[str, object], Field(description="stored by the starter at the fault, by code")
    ]
    fault_history: Annotated[list[Any], Field(description="the starter's own list, the newest first")]
    thinned: NotRequired[Annotated[str, Field(description="what was left out, for at most 16 KB")]]

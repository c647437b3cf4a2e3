"""The statistics of a line, as `gateway/line/{line}` says them. Shares are of the line's time, 0 to 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, NotRequired

from typing_extensions import TypedDict  # pydantic needs its own before Python 3.12

from gateway.contract.values import says


class _Counts(TypedDict):
    answered: Annotated[int, says("requests that were answered")]
    silent: Annotated[int, says("requests without a reply")]
    garbled: Annotated[int, says("requests with a corrupted reply")]
    refused: Annotated[int, says("requests that were answered by a Modbus exception")]


class _ResponseTimes(TypedDict):
    p50: Annotated[float | None, says("half of the replies came within, s")]
    p99: Annotated[float | None, says("99 of 100 replies came within, s")]


class UnitStatistics(_Counts):
    """The requests to one address and its replies."""

    asked: Annotated[int, says("requests")]
    corrupted: Annotated[int, says("garbled replies that were no frame")]
    late: Annotated[int, says("replies that came after their time")]
    response_time_s: Annotated[_ResponseTimes, says("of the latest 100 replies")]
    state: Annotated[Literal["new", "answering", "suspect", "silent"], says("its health")]


class _Watchdogs(TypedDict):
    load: Annotated[float, says("share of the line's time that they need alone")]
    longest_share: Annotated[float, says("longest pause, as a share of the watchdog's time")]
    unit: Annotated[int, says("the address that had this longest pause")]


class _UartErrors(TypedDict):
    frame: Annotated[int, says("framing errors")]
    overrun: Annotated[int, says("overruns of the UART")]
    parity: Annotated[int, says("parity errors")]
    break_: Annotated[int, says("breaks", alias="break")]  # `break` is no name in a class
    buffer_overrun: Annotated[int, says("overruns of the driver's buffer")]


class _StopLatency(TypedDict):
    computed: Annotated[float, says("the computed maximum, s")]
    worst: Annotated[float | None, says("the longest that was measured, s")]
    stops: Annotated[int, says("stops that were measured")]
    sum: Annotated[float, says("sum of their waits, s")]
    within: Annotated[Mapping[str, int], says("stops that waited at most so many seconds")]


class _Computed(TypedDict):
    load: Annotated[float, says("share of the line's time that the polls need")]
    sweep_s: Annotated[float, says("time for one request of each poll, at most, s")]
    stop_latency_s: Annotated[float, says("wait of a stop for its first byte, at most, s")]
    watchdog_margin_s: Annotated[float | None, says("least reserve of a communication watchdog, s")]
    is_paced: Annotated[bool, says("whether polls have periods; else the line is always full")]


class _Cable(TypedDict):
    texts: Annotated[list[str], says("findings, in words")]
    starters: Annotated[Mapping[str, object], says("rates of errors, by starter")]


class _Lag(TypedDict):
    line: Annotated[float, says("the lines' loop, s")]
    gateway: Annotated[float, says("the gateway's own loop, s")]


class LineStatistics(_Counts):
    """The counters and times of a line since the gateway began, but where a field says otherwise."""

    crashes: Annotated[NotRequired[int], says("restarts of the line's loop after an error")]
    is_open: Annotated[bool, says("whether its port is open")]
    stretch: Annotated[float, says("factor by which all periods are stretched; 1: not at all")]
    watchdogs: Annotated[_Watchdogs, says("demand of the starters' communication watchdogs")]
    progress: Annotated[int, says("grows with each step of the line's loop")]
    stray_bytes: Annotated[int, says("bytes that no request was waiting for")]
    uart_errors: Annotated[NotRequired[_UartErrors], says("counters of the adapter's driver")]
    utilisation: Annotated[float, says("share of time that the line was busy, 0 to 1")]
    sweep_s: Annotated[float, says("time for one request of each poll, s")]
    polls: Annotated[int, says("requests of polls")]
    jobs: Annotated[int, says("requests of commands and of identification")]
    stop_latency_s: Annotated[_StopLatency, says("wait of a stop for its first byte")]
    units: Annotated[Mapping[str, UnitStatistics], says("by address")]
    computed: Annotated[NotRequired[_Computed], says("the line budget that `check` prints")]
    cable: Annotated[NotRequired[_Cable], says("findings about the cable, from the errors")]
    lag_s: Annotated[NotRequired[_Lag], says("the longest delays of the program's loops")]

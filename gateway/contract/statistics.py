"""The statistics of a line, as `gateway/line/{line}` says them. Shares are of the line's time, 0 to 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict  # pydantic needs its own before Python 3.12


class _Counts(TypedDict):
    answered: Annotated[int, Field(description="requests that were answered")]
    silent: Annotated[int, Field(description="requests without a reply")]
    garbled: Annotated[int, Field(description="requests with a corrupted reply")]
    refused: Annotated[int, Field(description="requests that were answered by a Modbus exception")]


class _ResponseTimes(TypedDict):
    p50: Annotated[float | None, Field(description="half of the replies came within, s")]
    p99: Annotated[float | None, Field(description="99 of 100 replies came within, s")]


class UnitStatistics(_Counts):
    """The requests to one address and its replies."""

    asked: Annotated[int, Field(description="requests")]
    corrupted: Annotated[int, Field(description="garbled replies that were no frame")]
    late: Annotated[int, Field(description="replies that came after their time")]
    response_time_s: Annotated[_ResponseTimes, Field(description="of the latest 100 replies")]
    state: Annotated[Literal["new", "answering", "suspect", "silent"], Field(description="its health")]


class _Watchdogs(TypedDict):
    load: Annotated[float, Field(description="share of the line's time that they need alone")]
    longest_share: Annotated[float, Field(description="longest pause, as a share of the watchdog's time")]
    unit: Annotated[int, Field(description="the address that had this longest pause")]


_UartErrors = TypedDict(  # `break` is no name of a field in a class
    "_UartErrors",
    {
        "frame": Annotated[int, Field(description="framing errors")],
        "overrun": Annotated[int, Field(description="overruns of the UART")],
        "parity": Annotated[int, Field(description="parity errors")],
        "break": Annotated[int, Field(description="breaks")],
        "buffer_overrun": Annotated[int, Field(description="overruns of the driver's buffer")],
    },
)


class _StopLatency(TypedDict):
    computed: Annotated[float, Field(description="the computed maximum, s")]
    worst: Annotated[float | None, Field(description="the longest that was measured, s")]
    stops: Annotated[int, Field(description="stops that were measured")]
    sum: Annotated[float, Field(description="sum of their waits, s")]
    within: Annotated[Mapping[str, int], Field(description="stops that waited at most so many seconds")]


class _Computed(TypedDict):
    load: Annotated[float, Field(description="share of the line's time that the polls need")]
    sweep_s: Annotated[float, Field(description="time for one request of each poll, at most, s")]
    stop_latency_s: Annotated[float, Field(description="wait of a stop for its first byte, at most, s")]
    watchdog_margin_s: Annotated[
        float | None, Field(description="least reserve of a communication watchdog, s")
    ]
    is_paced: Annotated[bool, Field(description="whether polls have periods; else the line is always full")]


class _Cable(TypedDict):
    texts: Annotated[list[str], Field(description="findings, in words")]
    starters: Annotated[Mapping[str, object], Field(description="rates of errors, by starter")]


class _Lag(TypedDict):
    line: Annotated[float, Field(description="the lines' loop, s")]
    gateway: Annotated[float, Field(description="the gateway's own loop, s")]


class LineStatistics(_Counts):
    """The counters and times of a line since the gateway began, but where a field says otherwise."""

    crashes: Annotated[NotRequired[int], Field(description="restarts of the line's loop after an error")]
    is_open: Annotated[bool, Field(description="whether its port is open")]
    stretch: Annotated[float, Field(description="factor by which all periods are stretched; 1: not at all")]
    watchdogs: Annotated[_Watchdogs, Field(description="demand of the starters' communication watchdogs")]
    progress: Annotated[int, Field(description="grows with each step of the line's loop")]
    stray_bytes: Annotated[int, Field(description="bytes that no request was waiting for")]
    uart_errors: Annotated[NotRequired[_UartErrors], Field(description="counters of the adapter's driver")]
    utilisation: Annotated[float, Field(description="share of time that the line was busy, 0 to 1")]
    sweep_s: Annotated[float, Field(description="time for one request of each poll, s")]
    polls: Annotated[int, Field(description="requests of polls")]
    jobs: Annotated[int, Field(description="requests of commands and of identification")]
    stop_latency_s: Annotated[_StopLatency, Field(description="wait of a stop for its first byte")]
    units: Annotated[Mapping[str, UnitStatistics], Field(description="by address")]
    computed: Annotated[NotRequired[_Computed], Field(description="the line budget that `check` prints")]
    cable: Annotated[NotRequired[_Cable], Field(description="findings about the cable, from the errors")]
    lag_s: Annotated[NotRequired[_Lag], Field(description="the longest delays of the program's loops")]

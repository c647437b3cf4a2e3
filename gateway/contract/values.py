"""Objects inside of records: a point in `info`, the samples of a start, the further fields of a result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, NotRequired

from pydantic import Field
from typing_extensions import TypedDict  # pydantic needs its own before Python 3.12

from gateway.contract.vocabulary import Phase

_Value = Annotated[bool | int | float | str | None, Field(description="the value, in `unit`")]
_Unit = Annotated[str, Field(description="its unit; empty for none")]
_Label = Annotated[str | None, Field(description="the name of the value in the manual, of an enum")]
_Raw = Annotated[list[int], Field(description="the words as they were read")]
_Reason = Annotated[str, Field(description="why there is no value")]
_Column = Annotated[tuple[float | None, ...], Field(description="the point of this name")]
_Seen = Annotated[str | None, Field(description="accept: as the accepted device reports it")]


class PointInfo(TypedDict):
    """A point of a starter; `code` is null for one of the gateway's own."""

    code: Annotated[str | None, Field(description="its code in the manual")]
    name: Annotated[str, Field(description="its name in the manual")]
    meaning: Annotated[str, Field(description="its meaning, in the gateway's language")]
    unit: _Unit
    type: Annotated[str, Field(description="bool, int, float, enum or text")]
    enum: Annotated[Mapping[str, str] | None, Field(description="the names of its values")]
    deadband: Annotated[float | None, Field(description="a smaller change is not published")]
    every_s: NotRequired[
        Annotated[float, Field(description="of a point that the configuration asks for: its period, s")]
    ]


class StartSamples(TypedDict):
    """What was read during a start: columns of the same length."""

    t_s: Annotated[tuple[float, ...], Field(description="time from the start, s")]
    current: NotRequired[_Column]
    line_voltage: NotRequired[_Column]
    output_voltage: NotRequired[_Column]
    torque_pct: NotRequired[_Column]
    power_factor: NotRequired[_Column]
    thermal: NotRequired[_Column]


class ReadValue(TypedDict):
    """The value of a parameter, as it was read."""

    value: _Value
    unit: _Unit
    label: NotRequired[_Label]
    raw: NotRequired[_Raw]
    reason: NotRequired[_Reason]


class MemberEnd(TypedDict):
    """The outcome of a group's command at one member."""

    phase: Annotated[Phase, Field(description="its final phase")]
    code: Annotated[str, Field(description="why, for programs: see the result codes")]


class ResultValues(TypedDict, total=False):
    """Fields of a result besides those that every result has; each belongs to some verbs or codes."""

    parameter: Annotated[str, Field(description="the parameter that was read or set")]
    value: _Value
    unit: _Unit
    label: _Label
    raw: _Raw
    reason: _Reason
    values: Annotated[Mapping[str, ReadValue], Field(description="several parameters, by code")]
    select: Annotated[str, Field(description="select: the token for the command to come")]
    valid_s: Annotated[float, Field(description="select: the time for which it is valid, s")]
    state: Annotated[str, Field(description="select: the state that it holds for; crashed: the state now")]
    start: Annotated[str, Field(description="baseline: the start that others are compared with")]
    by: Annotated[str, Field(description="lock_removed: the client that removed it")]
    count: Annotated[int, Field(description="too_many: commands that this answers together")]
    serial: _Seen
    firmware: _Seen
    family: _Seen
    model: _Seen
    rated_current: _Seen
    members: Annotated[Mapping[str, MemberEnd], Field(description="of a group: each member's outcome")]

"""Objects inside of records: a point in `info`, the samples of a start, the further fields of a result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NotRequired

from pydantic import Field
from typing_extensions import TypedDict  # pydantic needs its own before Python 3.12

from gateway.contract.vocabulary import Phase


def says(description: str, **how: Any) -> Any:
    """Describe a field; `how` as pydantic's `Field` has it."""
    return Field(description=description, **how)


_Value = Annotated[bool | int | float | str | None, says("the value, in `unit`")]
_Unit = Annotated[str, says("its unit; empty for none")]
_Label = Annotated[str | None, says("the name of the value in the manual, of an enum")]
_Raw = Annotated[list[int], says("the words as they were read")]
_Reason = Annotated[str, says("why there is no value")]
_Column = Annotated[tuple[float | None, ...], says("the point of this name")]
_Seen = Annotated[str | None, says("accept: as the accepted device reports it")]


class PointInfo(TypedDict):
    """A point of a starter; `code` is null for one of the gateway's own."""

    code: Annotated[str | None, says("its code in the manual")]
    name: Annotated[str, says("its name in the manual")]
    meaning: Annotated[str, says("its meaning, in the gateway's language")]
    unit: _Unit
    type: Annotated[str, says("bool, int, float, enum or text")]
    enum: Annotated[Mapping[str, str] | None, says("the names of its values")]
    deadband: Annotated[float | None, says("a smaller change is not published")]
    every_s: NotRequired[Annotated[float, says("of a point that the configuration asks for: its period, s")]]


class StartSamples(TypedDict):
    """What was read during a start: columns of the same length."""

    t_s: Annotated[tuple[float, ...], says("time from the start, s")]
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

    phase: Annotated[Phase, says("its final phase")]
    code: Annotated[str, says("why, for programs: see the result codes")]


class ResultValues(TypedDict, total=False):
    """Fields of a result besides those that every result has; each belongs to some verbs or codes."""

    parameter: Annotated[str, says("the parameter that was read or set")]
    value: _Value
    unit: _Unit
    label: _Label
    raw: _Raw
    reason: _Reason
    values: Annotated[Mapping[str, ReadValue], says("several parameters, by code")]
    select: Annotated[str, says("select: the token for the command to come")]
    valid_s: Annotated[float, says("select: the time for which it is valid, s")]
    state: Annotated[str, says("select: the state that it holds for; crashed: the state now")]
    start: Annotated[str, says("baseline: the start that others are compared with")]
    by: Annotated[str, says("lock_removed: the client that removed it")]
    count: Annotated[int, says("too_many: commands that this answers together")]
    serial: _Seen
    firmware: _Seen
    family: _Seen
    model: _Seen
    rated_current: _Seen
    members: Annotated[Mapping[str, MemberEnd], says("of a group: each member's outcome")]

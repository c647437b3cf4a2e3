"""The shape of a family's profile: frozen models into which `family.toml` is loaded; its tables: `rows`.

A `Point` gives a row, one of its bits or a test of its value a name that all families share; a `Command` says
what a verb requires, writes and reads back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, TypeVar

from pydantic import Field

from gateway.contract import ResultCode
from gateway.families.profile.rows import Alarm, Model, Parameter, Table


class Point(Model):
    """A named quantity of a starter: a row, a bit of it, or a test of its value."""

    code: str = ""  # of the Parameter it is read from
    bit: int | None = Field(default=None, ge=0, le=15)
    true_when: tuple[int, ...] = ()  # a boolean: the raw value is one of these
    none_of: tuple[str, ...] = ()  # a boolean: all these points are false (no `code` then)
    group: Literal["status", "values", "slow", "extra"] = "values"  # extra: only where a site asks for it
    every_s: float | None = Field(default=None, gt=0)  # of an extra point; None: as its group
    deadband: float = 0.0  # in the row's unit
    zero_is_missing: bool = False  # the manual: 0 means "not available"
    meaning: str = ""  # of a quantity that is this family's alone

    @cached_property
    def source(self) -> str:
        """The row that it is read from, or the bit of it: VB01.8."""
        return self.code if self.bit is None else f"{self.code}.{self.bit}"


class Timing(Model):
    """Longest response times, from the request's last byte to the reply's first."""

    read_s: float
    write_s: float
    write_per_register_s: float  # FC16, for each written register
    restart_s: float = 0.0  # silence to be expected while the whole device restarts (S6-09)
    is_stated: bool = True  # False: the manual is silent, the numbers are ours


class Limits(Model):
    """The limits of one request to this family."""

    functions: tuple[int, ...]
    read_registers: int
    write_registers: int
    read_bits: int
    frame_bytes: int
    segment_devices: int | None = None  # on a line without repeaters; None = not stated
    max_gap: int = 0  # unknown registers that a block read may span (SSW900 7.3: they read 0)

    def most(self, table: Table) -> int:
        """Return the most registers or bits of a table that one request may read."""
        return self.read_bits if table.is_bits else self.read_registers


class Verify(Model):
    """How a command is seen to have acted: this point becomes this value, within this time."""

    point: str
    becomes: bool | int
    within_s: float


class Write(Model):
    """One write of a command: a coil, or bits of the command word."""

    coil: int | None = None  # address on the wire
    value: bool = True
    word: str = ""  # code of the command word row; where there are two slots, slot 1's stands for both
    set_bits: int = 0  # bits that become 1
    clear_bits: int = 0  # bits that become 0
    mask_shift: int | None = None  # SSW-06: each named bit also sets its mask bit, this many places up


class CommandBits(Model):
    """The bits of a command word; 0: it has no such bit. All others are reserved and stay 0."""

    run: int = 0x01
    general_enabled: int = 0
    jog: int = 0
    reverse: int = 0
    remote: int = 0
    reset: int = 0

    @property
    def all(self) -> int:
        """The bits that mean something."""
        return self.run | self.general_enabled | self.jog | self.reverse | self.remote | self.reset


class Command(Model):
    """A verb of this family: what is required, written and read back."""

    writes: tuple[Write, ...] = ()
    requires: tuple[str, ...] = ()  # rules of families/command/interlock.py
    verify: Verify | None = None
    restarts: bool = False  # the device restarts afterwards and is silent for `timing.restart_s`
    args: tuple[str, ...] = ()  # names of the arguments that the verb takes
    flags: tuple[str, ...] = ()  # switches that may be left out; `<verb>_<flag>` is what they choose
    values: tuple[str, str] = ("true", "false")  # of the argument `value`; the second chooses `<verb>_off`
    needs: dict[str, tuple[int, ...]] = {}  # rows that must hold one of these numbers
    ceilings: dict[str, Ceiling] = {}  # rows that must not read more
    note: str = ""  # what the operator must know once it is done
    refused_unless: str = ""  # a point: while it is false the starter may refuse it, and needs it not


class Output(Model):
    """A relay or an analog output of the starter that the serial line can drive."""

    word: str  # code of the row that drives it
    bit: int | None = Field(default=None, ge=0, le=15)  # of a relay, in the word
    full_scale: int | None = None  # of an analog output: the number that stands for 100 %
    function: str  # code of the row that says who drives the output
    option: int | None = None  # its number for the serial line; None = the manual does not print it


class Join(Model):
    """A text that lies over several rows."""

    codes: tuple[str, ...]  # in the order of their registers
    how: Literal["text", "version", "serial"]  # families/profile/word_types.py
    begins: str = ""  # what a plausible text begins with


class State(Model):
    """Which points make the state of a starter; a point that the family does not have says nothing."""

    order: dict[str, Literal["fault", "starting", "running", "stopping"]]  # the first that is true counts
    ready: tuple[str, ...]  # what must be true of a motor at rest that can be started
    starting: tuple[str, ...] = ()  # between an accepted start and the ramp
    waiting: tuple[str, ...] = ()  # after a stop, while a start is not carried out
    adjusting: str = ""  # not 0 while the motor cannot be run


class Rows(Model):
    """The kinds of rows, by the beginnings of their codes."""

    settings: tuple[str, ...] = ()  # what people set, neither readings nor outputs
    clock: tuple[str, ...] = ()  # settings that go on by themselves
    optional: tuple[str, ...] = ()  # only with an accessory: read alone, so that a missing one is refused
    automatic: tuple[str, ...] = ()  # settings that the starter's own program may write
    volatile: tuple[str, ...] = ()  # not stored in non-volatile memory
    set_note: str = ""  # what the operator must know once a setting was written


class Timeout(Model):
    """Two rows of one supervision, which must not be active with a time of 0."""

    mode: str  # 0: off
    time: str


class ShownBy(Model):
    """The bits of another row that show that a written row has acted."""

    written: int
    code: str
    mask: int
    becomes: int


class Protected(Model):
    """Rows that a `set` writes under conditions or not at all: by code, the section that says why."""

    command_sources: dict[str, str] = {}  # who commands the motor; a restore leaves them alone unless asked
    waking: dict[str, str] = {}  # may let a run command act that stands, without choosing its source
    connection: dict[str, str] = {}  # to set one cuts the connection to the starter: refused
    actions: dict[str, str] = {}  # no settings, but what the starter then does: refused
    password: dict[str, str] = {}  # not needed over the serial line, and not stored: refused
    site: dict[str, str] = {}  # by how their codes begin: no site may describe them as rows to be set
    stand_ins: tuple[tuple[int, int], ...] = ()  # first and last registers that are any others: no site may
    timeout: Timeout | None = None

    def wakes(self, code: str) -> bool:
        """Return whether a change of this row may let a run command act that stands in the starter."""
        return code in self.command_sources or code in self.waking

    def names(self, code: str) -> bool:
        """Return whether a row is protected in any way."""
        kinds = self.command_sources, self.waking, self.connection, self.actions, self.password
        return any(code in kind for kind in kinds)


class Ceiling(Model):
    """A reading above which a command is refused."""

    most: int  # raw
    unit: str
    models: tuple[str, ...]  # how the names of the models begin that have the reading
    refusal: ResultCode  # it says what to do


class LocalControl(Model):
    """The row that says who commands the motor in local mode."""

    code: str
    serial: tuple[int, ...]  # its number for this line; where there are two slots, that of each


class HistoryRows(Model):
    """Rows in which the starter itself says what has happened to it; by code, empty where it has none."""

    fault_history: tuple[str, ...] = ()  # newest first
    at_fault: tuple[str, ...] = ()  # what it stores of a fault, and what its cause shows in just after it
    at_start: tuple[str, ...] = ()  # what it stores of the last start
    thermal: str = ""  # level of its thermal image of the motor, in its own %; it must be a point too
    thermal_trip: float = 100.0  # at which it trips
    cooling: str = ""  # setting: time constant of cooling, min
    after_stop: str = ""  # setting: pause between a stop and a start, s
    between_starts: str = ""  # setting: pause between two starts, s
    hours: str = ""  # its own count of the time in operation, s
    energy: str = ""  # its own count, kWh


class Profile(Model):
    """A family, whole. It equals itself alone, so that what follows from it can be remembered by it."""

    __hash__ = object.__hash__
    __eq__ = object.__eq__

    family: str
    title: str
    source: str
    timing: Timing
    limits: Limits
    framings: tuple[str, ...]
    bauds: tuple[int, ...]  # empty: the manual does not say
    state: State
    rows: Rows = Rows()
    history: HistoryRows = HistoryRows()
    status_word: str = ""  # code of the status row
    command_word: tuple[str, ...] = ()  # code of the command word per slot (SSW900), one otherwise
    command_bits: CommandBits = CommandBits()  # needed of a word that is written whole, without a mask
    points: dict[str, Point]
    commands: dict[str, Command]
    joins: dict[str, Join] = {}  # by what they are: name, firmware, serial
    protected: Protected = Protected()
    local_control: LocalControl | None = None  # None: nothing gives the commands in local mode to this line
    shown_by: dict[str, ShownBy] = {}  # by the row that is written
    outputs: dict[str, Output] = {}  # by the name of their terminals: RL1, AO1, DO1
    parameters: dict[str, Parameter]  # by code
    enums: dict[str, dict[int, str]] = {}  # "VB01.0" is what 0 and 1 mean of a bit
    english_enums: dict[str, dict[int, str]] = {}  # of a translated profile: what a `set` takes as well
    bits: dict[str, dict[int, str]] = {}  # code -> bit -> label
    alarms: tuple[Alarm, ...] = ()
    alarm_rows: dict[str, Literal["a", "e", "f"]] = {}  # rows that hold an alarm's number, and its letter
    exceptions: dict[int, str] = {}  # what the manual gives as the causes of a Modbus exception
    raw_range: tuple[int, int] | None = None  # holding addresses readable as raw words: P0-P999
    first_coil: int = 0  # the number of the coil at address 0
    since_firmware: dict[str, dict[str, str]] = {}  # by row or bit, then by how the model begins; "": any
    simulated: dict[str, tuple[str, ...]] = {}  # options of its simulation; or the rows that set them

    @cached_property
    def rows_at(self) -> dict[tuple[Table, int], tuple[Parameter, ...]]:
        """The rows that begin at a table's address; more than one where the manual has aliases."""
        found: dict[tuple[Table, int], tuple[Parameter, ...]] = {}
        for row in self.parameters.values():
            key = (row.table, row.address)
            found[key] = (*found.get(key, ()), row)
        return found

    @cached_property
    def points_of(self) -> dict[tuple[str, int | None], str]:
        """The name of the point that is this row, or this bit of it; tests of a row's value are left out."""
        points = self.family_points.items()
        named = ((name, point) for name, point in points if point.code and not point.true_when)
        return {(point.code, point.bit): name for name, point in named}

    @cached_property
    def thermal_point(self) -> str:
        """The name of the point with the level of the motor's thermal image; empty without one."""
        return self.points_of.get((self.history.thermal, None), "")

    @cached_property
    def family_points(self) -> dict[str, Point]:
        """The points of the family, without those that a site asks for: from these alone follows anything."""
        return {name: point for name, point in self.points.items() if point.every_s is None}

    @cached_property
    def alarm_points(self) -> tuple[str, ...]:
        """The names of the points that read the number of a fault or an alarm."""
        return tuple(name for name, point in self.family_points.items() if point.code in self.alarm_rows)


_T = TypeVar("_T")


def once_per_profile(make: Callable[[Profile], _T]) -> Callable[[Profile], _T]:
    """Return `make` with its results remembered, for all starters of a family; they must never be changed."""
    return lru_cache(maxsize=512)(make)  # a site has a few profiles: most starters ask for the same points


def remade(profile: Profile, **changed: object) -> Profile:
    """Return a profile with other parts, which caches nothing of the former's."""
    fields = {name: getattr(profile, name) for name in Profile.model_fields}
    return Profile.model_validate({**fields, **changed})


@dataclass(frozen=True, slots=True)
class Variant:
    """The differences of a starter from others of its family; unknown until configured or identified."""

    model: str | None = None
    firmware: str | None = None
    rated_current_a: float | None = None
    slot: int | None = None  # SSW900: where the RS-485 accessory sits, 1 or 2

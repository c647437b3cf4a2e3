"""The shape of a family's profile: frozen models into which `family.toml` and its tables are loaded.

Everything readable in a starter is a `Parameter` row, named by the manual's code (P003, VB01, S1.1.4, R19,
COIL26). A `Point` gives a row, one of its bits or a test of its value a name that all families share.
"""

from __future__ import annotations

import enum
from functools import cached_property
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

RESERVED = "Reserved"  # the label of members and bits that the manuals give no meaning


OFF = "off"  # the label of a number that switches something off, and a value that sets it


class Model(BaseModel):
    """What all profile models share: nothing unknown, nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Table(enum.StrEnum):
    """The Modbus table a row lives in [APP 4.3]."""

    HOLDING = "holding"
    INPUT = "input"
    COIL = "coil"
    DISCRETE = "discrete"

    @property
    def is_bits(self) -> bool:
        """Return whether its addresses hold a bit each, not a register."""
        return self in (Table.COIL, Table.DISCRETE)


class Type(enum.StrEnum):
    """How the words of a row are read; 32-bit types and longer are low word first (SSW900 7.2.4)."""

    U16 = "u16"
    S16 = "s16"
    U8 = "u8"  # one word, high byte 0 (SSW900, table A.3)
    LOW_U8 = "low_u8"  # only the low byte carries the value (SST)
    LOW_S8 = "low_s8"  # two's complement of the low byte (SST register 13)
    U32 = "u32"
    S32 = "s32"
    ENUM = "enum"
    LOW_ENUM = "low_enum"  # an enum in the low byte (SST)
    BITS = "bits"
    BIT = "bit"  # a coil
    TIME = "time"  # u32 of seconds
    DATE = "date"
    IP_ADDRESS = "ip_address"
    MAC_ADDRESS = "mac_address"
    STRING = "string"
    VERSION_LOW = "version_low"  # low byte before the point, high byte after it (SST registers 1-2)
    VERSION_HIGH = (
        "version_high"  # high byte before the point, low byte as two digits after it (SST register 7)
    )


class Access(enum.StrEnum):
    """What the manual allows; only `RW` rows can be set, only verbs write `COMMAND` rows."""

    RO = "ro"
    RW = "rw"
    COMMAND = "command"  # moves or stops the motor (VB03, S5.2.5, COIL1): no `set` may name it
    NONE = "none"  # exists, but cannot be reached over the serial line


class Confidence(enum.StrEnum):
    """How sure the row is; only what the manual's text shows, perhaps repaired, may be written."""

    MANUAL = "manual"
    REPAIRED = "repaired"  # legible, but not printed intact
    INFERRED = "inferred"  # not legible: readable, never writable
    EXTRA = "extra"  # from other public documents: readable, never writable


class Preset(Model):
    """What the manuals print of a row beside its range."""

    factory: int | None = None  # the raw number as delivered; None = not printed
    off: int | None = None  # the raw number that switches it off
    full_scale: int | None = Field(default=None, ge=1)  # the raw number of 100 %: read and set in per cent
    longest: int | None = Field(default=None, ge=1)  # characters of a text


class ModelRange(Model):
    """The raw limits of a row on one model (SST register table); none at all: not used there."""

    model: str  # how the model's name begins, e.g. SST130i-75
    raw_min: int | None = None
    raw_max: int | None = None


class Parameter(Preset):
    """One row of a manual's table."""

    code: str  # as printed: P003, VB01, S1.1.4, R41, COIL26
    name: str
    table: Table
    address: int = Field(ge=0, le=0xFFFF)  # on the wire, zero-based
    words: int = Field(default=1, ge=1, le=16)
    type: Type
    decimals: int | None = Field(default=0, ge=0, le=4)  # value = raw / 10**decimals; None = not stated
    unit: str = ""
    raw_min: int | None = None
    raw_max: int | None = None
    access: Access
    ranges: tuple[ModelRange, ...] = ()  # where limits differ by model; raw_min, raw_max serve the others
    enum: str = ""  # key into `Profile.enums`; empty for none; a coil's members say what 0 and 1 mean
    alias_of: str = ""  # another code that the manual gives the same register
    confidence: Confidence = Confidence.MANUAL
    is_stopped_only: bool | None = None  # the manual's property "Stopped"; None = not stated
    is_rated_scaled: bool = False  # SSW-06 4.4: divided by ten on models of 820 A and up
    is_configuration: bool = False  # SST 4-6, 30-42: written in configuration mode only
    note: str = ""
    source: str = ""

    @property
    def is_sure(self) -> bool:
        """Return whether the manual's text shows that the row is there, and where."""
        return self.confidence in (Confidence.MANUAL, Confidence.REPAIRED)

    @property
    def is_writable(self) -> bool:
        """Return whether a `set` may name this row: allowed, surely read, its range known."""
        is_allowed = self.access is Access.RW and self.is_sure
        is_number = self.raw_min is not None and self.raw_max is not None
        return is_allowed and (is_number or self.is_settable_text)

    @property
    def is_settable_text(self) -> bool:
        """Return whether it is set by a text: a date, an address, or characters whose number is printed."""
        return self.type in (Type.DATE, Type.IP_ADDRESS) or bool(self.longest)


class Point(Model):
    """A named quantity of a starter: a row, a bit of it, or a test of its value."""

    code: str = ""  # of the Parameter it is read from
    bit: int | None = Field(default=None, ge=0, le=15)
    true_when: tuple[int, ...] = ()  # a boolean: the raw value is one of these
    none_of: tuple[str, ...] = ()  # a boolean: all these points are false (no `code` then)
    group: Literal["status", "values", "slow"] = "values"
    deadband: float = 0.0  # in the row's unit
    zero_is_missing: bool = False  # the manual: 0 means "not available"
    since_firmware: str = ""  # e.g. "1.40"; older firmware does not have it (SSW-07 4.2.1)


class Timing(Model):
    """Longest response times, from the request's last byte to the reply's first."""

    read_s: float
    write_s: float
    write_per_register_s: float  # FC16, for each written register
    restart_s: float = 0.0  # silence to be expected while the whole device restarts (S6-09)
    is_stated: bool = True  # False: the manual is silent, the figures are ours


class Limits(Model):
    """What one request may ask of this family."""

    functions: tuple[int, ...]
    read_registers: int
    write_registers: int
    read_bits: int
    frame_bytes: int
    segment_devices: int | None = None  # on a line without repeaters; None = not stated
    max_gap: int = 0  # unknown registers that a block read may span (SSW900 7.3: they read 0)


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
    since_firmware: str = ""  # older firmware does not know it
    note: str = ""  # what the operator must know once it is done


class Output(Model):
    """A relay or an analog output of the starter that the serial line can drive."""

    word: str  # code of the row that drives it
    bit: int | None = Field(default=None, ge=0, le=15)  # of a relay, in the word
    full_scale: int | None = None  # of an analog output: the number that stands for 100 %
    function: str  # code of the row that says who drives the output
    option: int | None = None  # its number for the serial line; None = the manual does not print it


class Alarm(Model):
    """A fault (latched, stops the motor) or an alarm (warns only)."""

    code: str  # lower case, as in the topic, digits as the manual prints them: e28, f005, a128, coil13
    severity: Literal["fault", "alarm"]
    text: str


class Join(Model):
    """A text that lies over several rows."""

    codes: tuple[str, ...]  # in the order of their registers
    how: Literal["text", "version", "serial"]  # families/profile/joined.py


class Protected(Model):
    """Rows that a `set` writes under conditions or not at all: by code, the section that says why."""

    command_sources: dict[str, str] = {}  # who commands the motor; a restore leaves them alone unless asked
    waking: dict[str, str] = {}  # may let a run command act that stands, without choosing its source
    connection: dict[str, str] = {}  # to set one cuts the connection to the starter: refused
    actions: dict[str, str] = {}  # no settings: they load, copy or erase whole sets of parameters: refused

    def wakes(self, code: str) -> bool:
        """Return whether a change of this row may let a run command act that stands in the starter."""
        return code in self.command_sources or code in self.waking


class Ceiling(Model):
    """A reading above which a command is refused."""

    most: int  # raw
    unit: str
    models: tuple[str, ...]  # how the names of the models begin that have the reading
    since_firmware: str = ""  # older firmware does not give it
    refusal: str  # a code of families/profile/refusals.py
    remedy: str  # what to do


class MappedWords(Model):
    """Registers that read whatever parameters are mapped onto them (ssw900 7.2.3)."""

    read: int = Field(ge=0, le=0xFFFF)  # the first of these registers
    map: int = Field(ge=0, le=0xFFFF)  # of the first one's own register, which holds a parameter's address
    words: int = Field(ge=1)  # how many there are


class Identification(Model):
    """How to learn who answers: by FC43 object 1, by registers, or both."""

    how: Literal["fc43", "sst_registers"]
    expect: tuple[str, ...]  # one of these begins the model text, e.g. "SSW-07"
    model_register: str = ""  # code of a register with a fixed value, e.g. VB00
    model_value: int | None = None


class Profile(Model):
    """A family, whole."""

    family: str
    title: str
    source: str
    timing: Timing
    limits: Limits
    framings: tuple[str, ...]
    bauds: tuple[int, ...]  # empty: the manual does not say
    identification: Identification
    state_rule: Literal["weg", "sst"]
    status_word: str = ""  # code of the status row
    command_word: tuple[str, ...] = ()  # code of the command word per slot (SSW900), one otherwise
    points: dict[str, Point]
    commands: dict[str, Command]
    fast_words: MappedWords | None = None  # None: the family has none
    joins: dict[str, Join] = {}  # by what they are: name, firmware, serial
    protected: Protected = Protected()
    outputs: dict[str, Output] = {}  # by the name of their terminals: RL1, AO1, DO1
    parameters: dict[str, Parameter]  # by code
    enums: dict[str, dict[int, str]] = {}  # "VB01.0" is what 0 and 1 mean of a bit
    bits: dict[str, dict[int, str]] = {}  # code -> bit -> label
    alarms: tuple[Alarm, ...] = ()
    alarm_rows: dict[str, Literal["a", "e", "f"]] = {}  # rows that hold an alarm's number, and its letter
    raw_range: tuple[int, int] | None = None  # holding addresses readable as raw words: P0-P999

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
        named = ((name, point) for name, point in self.points.items() if point.code and not point.true_when)
        return {(point.code, point.bit): name for name, point in named}


Word = Annotated[int, Field(ge=0, le=0xFFFF)]


class Variant(Model):
    """What distinguishes one starter from others of its family; unknown until configured or identified."""

    model: str | None = None
    firmware: str | None = None
    rated_current_a: float | None = None
    slot: Literal[1, 2] | None = None  # SSW900: where the RS-485 accessory sits

"""The rows of a family's tables, as frozen models: parameters, and the faults and alarms by their codes.

Everything readable in a starter is a `Parameter` row, named by the manual's code (P003, VB01, S1.1.4, R19,
COIL26). Which of them are points, what commands write and all else that `family.toml` says: `schema`.
"""

from __future__ import annotations

import enum
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

RESERVED = "Reserved"  # the label of members and bits that the manuals give no meaning


OFF = "off"  # the label of a number that switches something off, and a value that sets it


class Model(BaseModel):
    """The base of all profile models: nothing unknown, nothing changes after loading."""

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
    VERSION_HIGH = "version_high"  # high byte before it, low byte as two digits after it (SST register 7)


class Access(enum.StrEnum):
    """The access that the manual allows; only `RW` rows can be set, only verbs write `COMMAND` rows."""

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
    SITE = "site"  # described by the site from its own manual: read alone, writable as it says


class Preset(Model):
    """The numbers that the manuals print of a row beside its range."""

    code: str  # as printed: P003, VB01, S1.1.4, R41, COIL26
    factory: int | None = None  # the raw number as delivered; None = not printed
    off: int | None = None  # the raw number that switches it off
    full_scale: int | None = Field(default=None, ge=1)  # the raw number of 100 %: read and set in per cent
    longest: int | None = Field(default=None, ge=1)  # characters of a text


class ModelRange(Model):
    """The raw limits of a row on one model (SST register table); none at all: not used there."""

    code: str  # of the row
    model: str  # how the model's name begins, e.g. SST130i-75
    raw_min: int | None = None
    raw_max: int | None = None


class Parameter(Preset):
    """One row of a manual's table."""

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
        is_allowed = self.access is Access.RW and (self.is_sure or self.confidence is Confidence.SITE)
        is_number = self.raw_min is not None and self.raw_max is not None
        return is_allowed and (is_number or self.is_settable_text)

    @property
    def is_settable_text(self) -> bool:
        """Return whether it is set by a text: a date, an address, or characters whose number is printed."""
        return self.type in (Type.DATE, Type.IP_ADDRESS) or bool(self.longest)


class Alarm(Model):
    """A fault (latched, stops the motor) or an alarm (warns only)."""

    code: str  # lower case, as in the topic, digits as the manual prints them: e28, f005, a128, coil13
    severity: Literal["fault", "alarm"]
    text: str  # the manual's name, in the language of the profile
    confidence: Confidence = Confidence.MANUAL  # inferred: named as in another family, and the text says so
    source: str = ""

    @property
    def title(self) -> str:
        """Code and name: E05 Motor overload; the name alone where it has the code in it."""
        return self.text if self.code in self.text.lower() else f"{self.code.upper()} {self.text}"

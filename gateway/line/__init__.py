"""One RS-485 line: who is asked what and when, and what came of it.

Start at `service`, the loop on an open port. `scheduler` decides, `rtu` does one transaction, `port` handles
bytes, `capacity` computes what a line can serve. `thread` runs all lines beside the application.
Nothing outside reaches past this door.
"""

from gateway.line import capacity
from gateway.line.cable import CableHealth, WiredStarter
from gateway.line.client import LineClient
from gateway.line.direct import Survey
from gateway.line.events import LineEvent, LineFault, OnFrame, PollResult, PortChanged, UnitChanged
from gateway.line.port.base import PortOpener
from gateway.line.port.event_loop import new_precise_loop
from gateway.line.port.opener import SerialOpener
from gateway.line.port_recovery import DEAF
from gateway.line.rtu.forms import Forms
from gateway.line.rtu.outstanding import EXPIRES_S
from gateway.line.rtu.transaction import (
    ALLOWANCE_S,
    TOO_LATE,
    Answered,
    Garbled,
    Outcome,
    Refused,
    Silent,
    request_wire_s,
)
from gateway.line.scheduler.line_time import FREE_PERIOD_S
from gateway.line.scheduler.requests import Poll, Priority
from gateway.line.thread import LineHost

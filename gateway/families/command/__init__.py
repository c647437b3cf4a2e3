"""Verbs, interlocks and writes of all families. Start at `procedures`."""

from gateway.families.command.interlock import demand, points_needed
from gateway.families.command.procedures import TAKEN_BACK, build, prepare, stop, verbs

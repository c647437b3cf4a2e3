"""What this machine holds: `doctor` measures it, `check` compares a configuration with it."""

from gateway.cli.box.speed import BoxSpeed, measured
from gateway.cli.box.verdict import capacity, demands_of, excess

__all__ = ["BoxSpeed", "capacity", "demands_of", "excess", "measured"]

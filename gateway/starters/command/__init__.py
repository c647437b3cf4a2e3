"""The life of a command: admission, readings that decide, writes, read-back, result.

Start at `commands`; `report` has the table of steps, `run` the ordinary way, `stop` the one of stops.
"""

from gateway.starters.command.commands import Commands, Results
from gateway.starters.command.proofs import Proofs

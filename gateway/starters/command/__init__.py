"""The life of a command: admission, readings that decide, writes, read-back, result.

Start at `dispatcher`; `report` has the table of steps, `run` the ordinary way, `stop` the one of stops.
"""

from gateway.starters.command.dispatcher import Dispatcher
from gateway.starters.command.submit import Commands, Results

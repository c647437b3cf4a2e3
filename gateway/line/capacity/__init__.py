"""The promises that a line can keep: load, sweep, watchdogs, gaps after an outage; pure.

Start at `line_forecast`.
"""

from gateway.line.capacity.line_forecast import Forecast, Missed, forecast, least_whole
from gateway.line.capacity.outage import (
    FEEDS,
    LOOK_S,
    START_UP_S,
    WIDE_FACTOR,
    Gaps,
    Restart,
    first_requests_s,
    gaps_of,
)

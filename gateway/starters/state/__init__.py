"""One starter as a state: what is known of it, what has happened, what is published and when.

Start at `starter_state`: `advance` is the one function that decides. `publication` says when something goes
out; `snapshot` and `publisher` are what `gateway.starters.starter` holds around the two.
"""

from gateway.starters.state.availability import Availability
from gateway.starters.state.decoding import (
    PointSources,
    ReplyReader,
    Rows,
    Said,
    sources_of,
    type_of,
    unit_of,
)
from gateway.starters.state.publication import REFRESH_S, SOONEST_S
from gateway.starters.state.publisher import LockOf, PublishedFaults, StatePublisher
from gateway.starters.state.readings import (
    NO_POINTS,
    Moment,
    Points,
    Reading,
    Readings,
    Value,
    bad,
    good_values,
    stale,
)
from gateway.starters.state.snapshot import Snapshot
from gateway.starters.state.starter_state import (
    UNKNOWN,
    Happening,
    Happenings,
    NewReadings,
    StarterState,
    advance,
    unread,
)

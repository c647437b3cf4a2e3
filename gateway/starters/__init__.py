"""One starter: its values, its identity, its commands, and the rules for them.

Start at `starter`, the loop around `state` and `identity`; `command` carries commands out, and `policy` says
which may be. `services` reads in the background what no poll reads. Nothing outside reaches past this door,
but for the namespace `parameters`: sets of settings, for the command line.
"""

from gateway.starters import parameters
from gateway.starters.bulk_read import Ask, read_in_bulk
from gateway.starters.command import Commands, Proofs, Results
from gateway.starters.identity import FINGERPRINTS, KNOWN, identified, mismatch_in
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.own_points import OWN_POINT_NAMES, PublicationPace
from gateway.starters.own_points import own_points as own_points_of
from gateway.starters.policy.freshness import (
    BY_ISSUED_AT,
    MAX_AHEAD_S,
    Tokens,
    dated_alone,
)
from gateway.starters.policy.freshness import EVERY_S as TOKEN_EVERY_S
from gateway.starters.policy.policy import Policy, lock_restored
from gateway.starters.policy.rights import Rights
from gateway.starters.policy.start_rules import PolicySettings, RuleSet
from gateway.starters.services.past_reader import serve
from gateway.starters.setup import StarterSetup, ask, merged, polls_of
from gateway.starters.starter import StarterTelemetry
from gateway.starters.state import REFRESH_S, PublishedFaults, Reading, Readings, Value

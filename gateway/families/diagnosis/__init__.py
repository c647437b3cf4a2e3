"""The identity of an answering device, and the meaning of its settings for its operation.

Start at `identification` and `readiness_check`.
"""

from gateway.families.diagnosis.configured import wrong_settings
from gateway.families.diagnosis.identification import (
    candidates,
    contradiction,
    decision_reads,
    distinctive_rows,
    identify,
    identify_requests,
    matches,
    slot_trouble,
    stop_note,
    stop_profile,
    why_not,
    with_distinctive_rows,
)
from gateway.families.diagnosis.readiness_check import (
    readiness,
    readiness_codes,
    refuses_start,
    shortest_s,
    watchdog_codes,
    watchdogs,
    written_rows,
)

"""Which request a line sends next; pure: whoever calls says what time it is.

Start at `scheduler`: its head is the theory of operation, `Scheduler._choose` the precedence. `requests` is what
is asked of a line, `polls` and `job_queue` are the two tables, `units` is who answers, `watchdogs` the deadlines.
"""

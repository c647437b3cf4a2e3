"""Which request a line sends next; pure: the caller says what time it is.

Start at `scheduler`: its head is the theory of operation, `Scheduler.pick` has the precedence. `requests` is
what is asked of a line, `polls` and `job_queue` are the two tables, `units` says who answers, `watchdogs`
keeps the deadlines.
"""

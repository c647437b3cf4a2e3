"""Which request a line sends next; pure: the caller says what time it is.

Start at `scheduler`: its head is the theory of operation, `Scheduler.pick` has the precedence. `requests` is
what is asked of a line, `polls` is the table of polls and of deadlines, `units` says who answers.
"""

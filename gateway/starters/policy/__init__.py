"""Whether a command may be carried out: rights, locks, selection, start rules, limits; pure.

Start at `policy`, which holds the rules together with what must outlive a run.
"""

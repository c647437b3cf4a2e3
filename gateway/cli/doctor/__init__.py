"""`doctor`: finds problems of the machine, the broker and the starters' settings. Start at `doctor`."""

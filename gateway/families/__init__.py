"""The starters' families as data, and what follows from it; pure.

`profile` loads and decodes, `reading` makes few reads of many rows, `devices` holds what each family alone
does, `command` makes writes of verbs, `diagnosis` says who answers and what is not right.
"""

"""The starters' families as data, and what follows from it; pure.

`profile` loads and decodes, `reading` makes few reads of many rows, `command` turns verbs into writes,
`diagnosis` says what is not right.
"""

"""Which files a state directory has, in which version each is written, and how an older one becomes that.

Start at `catalogue`.
"""

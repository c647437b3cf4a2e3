"""What is done to a state directory from outside: versions looked at, backups made and put back.

Start at `versions` and `archive`.
"""

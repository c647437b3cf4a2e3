"""`restore`: what a backup holds, or the files of before an upgrade, put back. Start at `restore`."""

"""Few reads for many rows. Start at `poll_blocks` for polls and `bulk` for everything else."""

"""`parameters`: save, compare and restore the parameters of a starter. Start at `parameters`."""

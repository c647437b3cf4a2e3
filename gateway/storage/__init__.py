"""The files of a state directory as a whole: their names and formats, and copies of them."""

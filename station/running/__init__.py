"""The composition root: puts a station together and runs it."""

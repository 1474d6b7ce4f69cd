"""Recorded traffic: candump, ASC and BLF files, read to their end or to their damage."""

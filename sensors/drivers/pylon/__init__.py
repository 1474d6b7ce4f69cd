"""Basler cameras through pylon, the maker's library, and its emulation without hardware."""

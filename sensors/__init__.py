"""Everything that yields images: camera drivers, stereo heads, the simulator, and the recorded formats."""

"""The mathematics of the station: arrays in, values out. No files, no clock, no threads, no configuration."""

"""Calibration: one camera, a head, the whole rig, and correction functions."""

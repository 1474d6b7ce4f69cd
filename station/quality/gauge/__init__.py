"""Gauge studies: planned, filled, analysed, certified."""

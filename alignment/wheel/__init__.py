"""Plane, surface of revolution and spin axis of one wheel, with uncertainty."""

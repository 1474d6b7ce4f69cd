"""Thresholds, edges, marks, light lines: from pixels to places in one image."""

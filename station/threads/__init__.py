"""Threads that cannot die unseen."""

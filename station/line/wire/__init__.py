"""Frames and bits: buses, protection, and what each message carries."""

"""Reports of results: what they count and compare, and how they are shown."""

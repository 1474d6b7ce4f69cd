"""The station's own store: its database, the work beside it, and the archive of images."""

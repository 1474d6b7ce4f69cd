"""What keeps a database well: checks, backups, retention, shipping, the work beside the station."""

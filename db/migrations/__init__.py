"""Every schema revision of the result store, in order; `db.migrate` runs them."""

"""Every schema revision of the result store, in order; `db.connection.migrate` runs them."""

"""Every schema revision of the result store, in order; `db.connection.revisions` runs them."""

"""How alembic runs a migration here: on the connection and in the transaction that it is given."""

from alembic import context

from db.schema import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    # Both databases roll back DDL; alembic assumes that SQLite does not.
    transactional_ddl=True,
    # SQLite alters a table only by copying it.
    render_as_batch=True,
)
with context.begin_transaction():
    context.run_migrations()

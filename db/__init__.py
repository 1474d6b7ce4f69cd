"""The result store: schema, migrations, writing, quality queries."""

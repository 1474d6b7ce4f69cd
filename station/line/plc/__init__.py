"""The controller's side: a simulated one, for rehearsals and tests."""

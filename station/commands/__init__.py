"""The verbs of the command line, one module per noun; each loads what it needs only when it runs."""

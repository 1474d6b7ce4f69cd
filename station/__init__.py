"""The application: configuration, measuring cycle, line (CAN) interface, command line."""

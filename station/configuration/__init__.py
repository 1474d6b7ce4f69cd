"""What a station is told: its configuration, the vehicle types, and a starter to begin with."""

"""What the quality engineer asks: gauge studies and reports, from statistics and the result database."""

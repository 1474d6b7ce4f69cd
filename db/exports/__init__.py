"""Results for other programs and for paper: Q-DAS AQDEF, CSV, Parquet, PDF. Angles leave in degrees."""

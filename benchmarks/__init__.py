"""The program beside its peers: both in one run, on the same data, as ratios."""

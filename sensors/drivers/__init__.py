"""Camera drivers, one module each; all pass the same contract tests."""

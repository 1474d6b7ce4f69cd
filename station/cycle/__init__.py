"""From trigger to answer: the measuring cycle and its words."""

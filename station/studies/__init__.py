"""The accuracy studies: each repeats an experiment many times and sets what comes out beside its goal."""

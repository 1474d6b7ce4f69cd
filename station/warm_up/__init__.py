"""Compiles what a work needs before it begins, so that no measurement waits for a compiler.

Others use `warm_up` (everything compiled, in processes of its own), `missing` and the works of `kernels`.
"""

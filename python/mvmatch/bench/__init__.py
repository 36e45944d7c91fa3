"""Benchmarks against the truth: sequences, front ends, measures, tables.

Nothing of it is needed to use mvmatch. It is here so that what the documentation says can be
measured again with one command (docs/accuracy.md).
"""

"""Benchmarks of labkit against other solvers: python -m tests.benchmarks (not part of the tests)."""

"""Benchmarks of labkit against other solvers, not part of the tests.

python -m tests.benchmarks
"""

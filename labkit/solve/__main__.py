"""python -m labkit.solve.

Compile the core and keep it on disk (once a machine, about a quarter of a minute).
"""

from .backend import load_core

if __name__ == "__main__":
    load_core(here=True)

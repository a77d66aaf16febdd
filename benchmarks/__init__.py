"""Measurements: how fast it is beside what else there is, and others that decided how it was built.

`python -m benchmarks` measures all tables of docs/performance.md and writes that page. Each module
prints its own: `python -m benchmarks.observe`.
"""

import os

# One thread unless a table says otherwise: BLAS and OpenMP read this once, when they are loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")

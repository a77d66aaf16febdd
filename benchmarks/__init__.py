"""Measurements of speed and memory, compared with other packages.

`python -m benchmarks` measures all tables of docs/performance.md and writes that page. Each module
prints its own tables: `python -m benchmarks.observe`.
"""

import os

# One thread unless a table says otherwise. BLAS and OpenMP read this once, when they are loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")

"""What the figures of README.md and docs/ are measured with: a script for each table, run as `.venv/bin/python -m benchmarks.NAME`.

footing.py is what they share, tables.py puts their tables into the pages. They run on one thread and draw off
screen unless the environment says otherwise; both are set here, before any of them imports a library that reads it.
"""

import os

for _name, _value in {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}.items():
    os.environ.setdefault(_name, _value)

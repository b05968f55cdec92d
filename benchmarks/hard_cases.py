"""The hard cases of the equilibrium solver, as the table in docs/verification.md; the cases stand in tests/hard_cases.py.

    .venv/bin/python benchmarks/hard_cases.py               about a minute
    .venv/bin/python benchmarks/hard_cases.py column arch   those whose name has one of these words in it
    .venv/bin/python benchmarks/hard_cases.py --roughness   of the reaction against the path, by kind of contact
"""

import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

from dataclasses import replace

from benchmarks.equilibrium import PRESS
from physics.scene import read_scene
from tests.hard_cases import CASES, roughness

if sys.argv[1:] == ["--roughness"]:
    press = read_scene(PRESS)
    for contact in ("facets", "nodes"):
        print(f"{contact}: {roughness(replace(press, obstacle=replace(press.obstacle, contact=contact))):.2%} of the mean force")
    raise SystemExit

print("| case | steps asked | halvings | iterations | error | held against | outcome |")
print("|---|---:|---:|---:|---:|---|---|")
for name, run in CASES.items():
    if len(sys.argv) == 1 or any(word in name for word in sys.argv[1:]):
        row = run()
        print(f"| {name} | {row.asked} | {row.halvings} | {row.iterations} | {row.error:.1e} | {row.reference} | {row.outcome} |",
              flush=True)

"""What motion keeps, what it loses and what it costs: the table of motion in docs/verification.md.

    .venv/bin/python benchmarks/dynamics.py
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent))

from physics.scene import Scene, Steps
from physics.solution import solve
from tests import test_physics_dynamics as motion
from tests.scenes import pressed


def seconds(scene: Scene) -> float:
    """Processor time [s] of a step."""
    started = time.process_time()
    solve(scene)
    return (time.process_time() - started) / scene.steps.count


def main() -> None:
    print("| case | expected | found |\n|---|---|---|")
    for element in ("standard", "mean-dilatation"):
        x, y, hz = motion.csm3(element)
        print(f"| Turek and Hron's CSM3, 280 x 8 hexahedra, {element}: lowest u_x, u_y, frequency | -28.61 mm, -128.77 mm, 1.0995 Hz "
              f"| {1e3 * x:.2f} mm, {1e3 * y:.2f} mm, {hz:.4f} Hz |", flush=True)
    for law in ("neo-hookean", "saint-venant-kirchhoff"):
        solution, lost = motion.energy_lost(law)
        print(f"| {law}: change of energy in 100 periods of 30 steps, over the largest stored energy | 0 "
              f"| {abs(lost).max() / solution.energy.max():.1e} |", flush=True)
    for cells in (2, 4, 8):
        energy = motion.total_energy(solve(motion.thrown(cells=cells)))
        print(f"| energy of a block of {cells} x {cells} x {cells} cells after it has bounced | {100 - 50 / cells:g} % "
              f"| {100 * energy[-1] / energy[0]:.1f} % |", flush=True)
    scene = pressed(steps={"count": 400})
    slow = replace(scene, steps=Steps(count=400, duration=4.0, dynamic=True))
    seconds(replace(scene, steps=Steps(count=2)))  # compiles, if need be
    still, moving = seconds(scene), seconds(slow)
    print(f"| a step of motion over one of equilibrium, beam under a cylinder, 400 steps in 4 s | – | {moving / still:.2g} |")


if __name__ == "__main__":
    main()

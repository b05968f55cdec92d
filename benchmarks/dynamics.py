"""What motion keeps, what it loses and what it costs: the table of motion in docs/verification.md.

    .venv/bin/python -m benchmarks.dynamics
"""

from dataclasses import replace

from benchmarks import footing
from physics.scene import Steps
from physics.solution import solve
from tests import test_physics_dynamics as motion
from tests.scenes import pressed


def main() -> None:
    footing.parser(__doc__).parse_args()
    table = footing.Table()
    for element in ("standard", "mean-dilatation"):
        x, y, hz = motion.csm3(element)
        table.add({"case": f"Turek and Hron's CSM3, 280 x 8 hexahedra, {element}: lowest u_x, u_y of the tip, frequency",
                   "expected": "-28.61 mm, -128.77 mm, 1.0995 Hz", "found": f"{1e3 * x:.2f} mm, {1e3 * y:.2f} mm, {hz:.4f} Hz"})
    for law in ("neo-hookean", "saint-venant-kirchhoff"):
        solution, lost = motion.energy_lost(law)
        table.add({"case": f"{law} beam: change of energy in 100 periods of 30 steps, over the largest stored energy",
                   "expected": 0, "found": f"{abs(lost).max() / solution.energy.max():.1e}"})
    for cells in (2, 4, 8):
        energy = motion.total_energy(solve(motion.thrown(cells=cells)))
        table.add({"case": f"energy of a block of {cells} x {cells} x {cells} cells after it has bounced on a floor",
                   "expected": f"{100 - 50 / cells:g} %", "found": f"{100 * energy[-1] / energy[0]:.1f} %"})
    scene = pressed(steps={"count": 400})
    moving = replace(scene, steps=Steps(count=400, duration=4.0, dynamic=True))
    solve(replace(scene, steps=Steps(count=2)))  # compiles, if need be
    still, moved = footing.median(lambda: solve(scene), 3), footing.median(lambda: solve(moving), 3)
    table.add({"case": "a step of motion over one of equilibrium, beam under a cylinder, 400 steps in 4 s",
               "found": f"{moved / still:.2g} times the processor time"})


if __name__ == "__main__":
    main()

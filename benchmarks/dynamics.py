"""What motion keeps, what it loses and what it costs: the table of motion in docs/verification.md.

    .venv/bin/python -m benchmarks.dynamics
    .venv/bin/python -m benchmarks.dynamics --error     an error that is asked for, in docs/equilibrium.md
"""

from dataclasses import replace
from typing import Any

from benchmarks import footing
from physics.accuracy.estimate import distance
from physics.accuracy.meshes.ladder import families
from physics.accuracy.motion import Floats, Motions, choose_motion
from physics.scene import Scene, Steps
from physics.solution import solve
from tests import test_physics_dynamics as motion
from tests.scenes import beam, pressed

SIDES = {"body": {"length": 0.1, "width": 0.02, "height": 0.01},
         "material": {"young_modulus": 1e6, "poisson_ratio": 0.3, "density": 1000.0}, "support": [{"where": "x-min"}]}
MOTIONS: dict[str, dict[str, Any]] = {
    "a load at the tip, there at once": SIDES | {
        "load": [{"where": "x-max", "traction": [0.0, 0.0, -200.0], "sudden": True}],
        "steps": {"count": 100, "duration": 0.5, "dynamic": True}},
    "struck by a cylinder": SIDES | {
        "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.08, 0.01, 0.0205], [0.08, 0.01, 0.0055]]},
        "steps": {"count": 50, "duration": 0.1, "dynamic": True}},
    "a load that grows and is taken off": SIDES | {
        "load": [{"where": "x-max", "traction": [0.0, 0.0, -400.0], "steps": [0.0, 0.3, 0.6, 1.0], "factor": [0.0, 1.0, 0.0, 0.0]}],
        "steps": {"count": 100, "duration": 1.0, "dynamic": True}}}
TRUTH, TRUE_STEPS = (18, 4, 3), 1600  # hexahedra of second order, and steps of time


def asked(name: str, table: footing.Table) -> None:
    """A motion of a beam at two errors, against one on a fine mesh in many steps."""
    truth = None
    for error in (0.1, 0.03):
        scene = beam(**(MOTIONS[name] | {"steps": MOTIONS[name]["steps"] | {"error": error}}))
        found = choose_motion(scene)
        truth = truth or _truth(scene)
        motions, values, itself = truth
        rows = {row["choice"]: row for row in found.verdict.rows}
        table.add({"motion": name, "asked [%]": 100 * error, "estimated [%]": 100 * found.verdict.estimated,
                   "true [%]": 100 * distance(motions.of(found.scene, found.solution, motions.compared), values, motions.weights),
                   "of the truth itself [%]": 100 * itself, "mesh": rows["the whole scene"]["taken"].split(",")[0],
                   "steps of time": rows["steps of time"]["taken"].split(",")[0], "seconds": rows["the search"]["seconds"]})


def _truth(scene: Scene) -> tuple[Motions, Floats, float]:
    kinds = sorted(families(scene), key=lambda family: family.order)
    motions = Motions(scene, kinds, "displacement", 1e-6, TRUE_STEPS)
    values = motions(kinds[-1], TRUTH).values
    coarser = motions.moved(kinds[-1], tuple(max(2, 2 * n // 3) for n in TRUTH), TRUE_STEPS).values
    fewer = motions.moved(kinds[-1], TRUTH, TRUE_STEPS // 2).values
    return motions, values, distance(coarser, values, motions.weights) / 1.5 + distance(fewer, values, motions.weights) / 2


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--error", action="store_true")
    options = parser.parse_args()
    table = footing.Table()
    if options.error:
        for name in MOTIONS:
            asked(name, table)
        return
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

"""The hard cases of the equilibrium solver, each with what it is held against; for the tests and for the table in docs/verification.md.

`CASES` has a function for each, and `SIBLINGS` some more of its kind: other places, sizes, laws, meshes. Each solves and returns a `Row`.
The error is relative to the largest value of what is compared; `limit` bounds it for the reason given in the comment beside it.
Legend: N nodes, T frames.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.optimize
import scipy.signal
from scipy.special import ellipe, ellipk

from physics.equilibrium.path import LoadPath
from physics.mesh.build import build_mesh
from physics.scene import Support, read_scene
from physics.solution import solve
from tests import plain_newton
from tests.scenes import beam, pressed

SOLVED = 1e-5  # both solve their equations to 1e-6 of the reaction, which a beam turns into about as much of its displacement
BLOCK = {"body": {"length": 0.02, "width": 0.02, "height": 0.02, "cells": [4, 4, 4]}, "support": [{"where": "z-min", "fixed": "xyz"}],
         "obstacle": {"shape": "half-space", "normal": [0.0, 0.0, -1.0], "path": [[0.0, 0.0, 0.0201], [0.0, 0.0, 0.01]]}}


@dataclass(frozen=True)
class Row:
    """What became of a case."""

    asked: int  # steps
    halvings: int
    iterations: int
    error: float
    limit: float
    reference: str
    outcome: str


def row(solution, asked, error, limit, reference):
    steps = np.flatnonzero(solution.snap)
    outcome = f"snaps at step {', '.join(map(str, steps))}" if len(steps) else "all steps"
    return Row(asked, solution.halvings, int(solution.newton_iterations.sum()), float(error), limit, reference,
               solution.failure or outcome)


def against_plain(scene, mesh=None):
    """Held against plain full Newton with the same contact points, on the last step."""
    ours, plain = solve(scene, mesh=mesh, partial=True), plain_newton.solve(scene, mesh=mesh)
    error = abs(ours.displacement[-1] - plain[-1]).max() / abs(plain[-1]).max()
    return row(ours, scene.steps.count, error, SOLVED, "plain Newton")


def against_small_steps(scene, count):
    """Held against the last state of the same loading in more steps."""
    ours, small = solve(scene, partial=True), solve(replace(scene, steps=replace(scene.steps, count=count)))
    assert not small.failure
    error = abs(ours.displacement[-1] - small.displacement[-1]).max() / abs(small.displacement[-1]).max()
    return row(ours, scene.steps.count, error, SOLVED, f"{count} steps")


def work_on(scene, solution):
    """(T,) [J] work of the obstacle up to each frame, by the trapezoidal rule; of the step of a snap what came before it."""
    way = np.linspace(0, 1, len(solution.displacement))
    path = np.array(scene.obstacle.path)
    centre = np.stack([np.interp(way, np.linspace(0, 1, len(path)), component) for component in path.T], axis=1)
    middle = -(solution.reaction[1:] + solution.reaction[:-1]) / 2
    middle[solution.snap[1:] > 0] = -solution.reaction[:-1][solution.snap[1:] > 0]
    return np.concatenate([[0], np.cumsum((middle * np.diff(centre, axis=0)).sum(axis=1))])


def against_work(scene, limit):
    """Held against the work that the obstacle did: it is stored, or was released in a snap."""
    ours = solve(scene, partial=True)
    work = work_on(scene, ours)
    error = abs(work - ours.energy - np.cumsum(ours.released)).max() / work.max()
    return row(ours, scene.steps.count, error, limit, "work = stored + released")


def nearly_incompressible(poisson_ratio, count=80, **changes):
    """In as many steps as plain Newton needs."""
    return against_plain(pressed(material={"young_modulus": 1e6, "poisson_ratio": poisson_ratio}, steps={"count": count}, **changes))


def corner(at=(0.06, 0.02), radius=0.005, **changes):
    path = [[*at, 0.0201 + radius], [*at, 0.008 + radius]]
    return against_plain(beam(obstacle={"shape": "sphere", "radius": radius, "path": path}, **changes))


def box_edge(at=0.045, size=(0.02, 0.03, 0.02), **radius):
    path = [[at, 0.01, 0.0201 + size[2] / 2], [at, 0.01, 0.005 + size[2] / 2]]
    return against_plain(beam(obstacle={"shape": "box", "size": list(size), **radius, "path": path}))


def bridge(wide=0.02, at=0.03):
    """A flat box wider than the bend of the beam that it presses: it touches at two of its edges and not between them."""
    box = {"shape": "box", "size": [wide, 0.03, 0.02], "path": [[at, 0.01, 0.0205], [at, 0.01, 0.0135]]}
    both = [{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "xyz"}]
    return beam(obstacle=box, support=both, body={"length": 0.06, "width": 0.02, "height": 0.01, "cells": [24, 4, 2]})


def two_regions(**where):
    return against_plain(bridge(**where))


def force_on_obstacle(scene):
    """(T,) [N] from the first touch on."""
    force = np.linalg.norm(solve(scene).reaction, axis=1)
    return force[np.flatnonzero(force)[0]:]


def roughness(scene, force=None):
    """How far the force on the obstacle is from steady: its distance from cubics over half of the path, root mean square over mean."""
    force = force_on_obstacle(scene) if force is None else force
    half = scene.steps.count // 4
    off = (force - scipy.signal.savgol_filter(force, 2 * half + 1, 3))[half:-half]
    return float(np.sqrt(np.mean(off**2)) / force.mean())


def in_steps(count, **changes):
    return against_small_steps(pressed(steps={"count": count}, **changes), 40)


def block(count, **material):
    return read_scene({"material": {"young_modulus": 1e6, "poisson_ratio": 0.4} | material, "steps": {"count": count}, **BLOCK})


def squeezed(**material):
    # 100 steps of the trapezoidal rule on a force that grows as fast as this one.
    return against_work(block(100, **material), 5e-3)


def squeezed_at_once(**material):
    return against_small_steps(block(1, **material), 40)


def slipping(shape, at, end, radius=0.01):
    path = [[*at, 0.0205 + radius], [*at, end]]
    return beam(obstacle={"shape": shape, "radius": radius, "path": path}, steps={"count": 200})


SLIPPING = {"slips off the tip": slipping("cylinder", [0.055, 0.01], -0.0305),
            "slips off sideways": slipping("sphere", [0.055, 0.014], -0.0255)}


def slips_off_the_tip(scene=SLIPPING["slips off the tip"]):
    return against_work(scene, 1 / 150)  # in the step of a snap the force is known at its start only


def slips_off_sideways(scene=SLIPPING["slips off sideways"]):
    """A sphere beside the middle of the beam: the beam turns and bends aside until it slips off."""
    return against_work(scene, 2 / 150)  # as above; it snaps twice


def distorted(seed=0, **changes):
    """All inner nodes of the mesh moved by up to 30 % of a cell, those of the surface within their faces."""
    scene = pressed(**changes)
    mesh = build_mesh(scene.body)
    extent = np.array(scene.body.extent)
    free = (mesh.points > 1e-9) & (mesh.points < extent - 1e-9)
    share = np.random.default_rng(seed).uniform(-0.3, 0.3, mesh.points.shape) * extent / np.array(scene.body.cells)
    return against_plain(scene, replace(mesh, points=mesh.points + np.where(free, share, 0)))


def flat_cells(cells=(2, 30, 3)):
    """Cells 50 times as long as wide."""
    return against_plain(pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": list(cells)}))


def slender(**changes):
    """A beam of slenderness 100 without Poisson's effect; cells that do not lock in bending."""
    return read_scene({"body": {"length": 1.0, "width": 0.01, "height": 0.01, "cells": [200, 1, 1], "element": "reduced"},
                       "material": {"young_modulus": 1e6, "poisson_ratio": 0.0}, "support": [{"where": "x-min", "fixed": "xyz"}]} | changes)


BISSHOPP = {  # P L^2 / E I: deflection / L, shortening / L, angle of the tip [degrees]
    0.5: (0.162144, 0.015919, 14.011), 1: (0.301721, 0.056433, 26.434), 2: (0.493457, 0.160642, 44.791),
    5: (0.713792, 0.387628, 69.635), 10: (0.810609, 0.554996, 81.949)}


def tip(mesh, u, across=2):
    """Displacement of the end face at x-max along x and across, its means, and how far it has turned from there [degrees]."""
    end = mesh.places["x-max"]
    high = mesh.points[end, across] > mesh.points[end, across].mean()
    x = (mesh.points + u)[end]
    up = x[high].mean(axis=0) - x[~high].mean(axis=0)
    return *u[end].mean(axis=0)[[0, across]], np.degrees(np.arctan2(up[0], up[across]))


def dead_tip_load(side=0.01, sideways=False):
    """Bisshopp and Drucker's cantilever at all five loads; the error is of the length, and of a right angle."""
    largest = 10
    load = largest * 1e6 * side**4 / 12
    body = {"length": 1.0, "width": side, "height": side, "cells": [200, 1, 1], "element": "reduced"}
    traction = np.roll([0.0, 0.0, -load / side**2], -sideways)
    scene = slender(body=body, load=[{"where": "x-max", "traction": traction.tolist()}], steps={"count": 20})
    ours = solve(scene, partial=True)
    errors = []
    for level, (deflection, shortening, angle) in BISSHOPP.items():
        along, down, turn = tip(ours.mesh, ours.displacement[round(20 * level / largest)], 1 if sideways else 2)
        errors += [-down - deflection, -along - shortening, (turn - angle) / 90]
    # Shear and stretch, which the elastica has not, are worth (H / L)^2, at most 4e-4; cells of L / 200 about (10 / 200)^2 / 24 = 1e-4.
    return row(ours, 20, np.abs(errors).max(), 1e-3, "Bisshopp and Drucker, five loads")


def rolled_up(high=0.01):
    """The end face of the slender beam is led round one whole circle: its force and moment are those of pure bending.

    A scene moves supports on straight lines only, so the displacements of the end are given to the path anew at each step. The
    beam is twice as wide as high: one with a square section closes to a ring that can turn inside out without any force.
    """
    scene, count = slender(
        body={"length": 1.0, "width": 2 * high, "height": high, "cells": [200, 2, 1], "element": "reduced"},
        support=[{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "xyz", "displacement": [1.0, 0.0, 0.0]}]), 72
    path = LoadPath(scene, build_mesh(scene.body))
    rest, end, iterations, errors = path.balance.mesh.points, path.balance.mesh.places["x-max"], 0, []
    height, full = rest[end, 2] - high / 2, 2 * np.pi * 1e6 * 2 * high**4 / 12
    for step in range(1, count + 1):
        angle = 2 * np.pi * step / count
        centre = np.array([np.sin(angle) / angle, 0, (1 - np.cos(angle)) / angle])
        there = centre + height[:, None] * np.array([-np.sin(angle), 0, np.cos(angle)])
        path.balance.target[end, 0::2] = (there + [0, 0, high / 2] - rest[end])[:, 0::2] * count / step
        state = path.advance(step / count)
        iterations += state.iterations
        force = path.balance.elasticity.force(state.u)[end]
        moment = -np.cross(there - centre, force)[:, 1].sum()
        errors += [abs(moment / full - step / count), np.linalg.norm(force.sum(axis=0)) / full]
    # Strains of 3 %, squared: the law is not linear.
    return Row(count, path.halvings, iterations, float(max(errors)), 2e-3, "M = 2 pi E I / L without force", "all steps")


def column(push, high=0.02, **changes):
    """The path of a clamped column, pushed [m/s2] from the side, while its ends come nearer by a fifth of its length."""
    scene = slender(
        body={"length": 1.0, "width": 0.03, "height": high, "cells": [100, 1, 1], "element": "reduced"},
        support=[{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "xyz", "displacement": [-0.2, 0.0, 0.0]}],
        load=[{"acceleration": [0.0, 0.0, push]}] if push else [], **changes)
    return solve(scene, partial=True)


def elastica(shortening, slenderness):
    """P L^2 / E I of a clamped column whose ends have come nearer by a share of its length: four quarters of an inflexional elastica."""
    def nearer(m):
        force = 16 * ellipk(m) ** 2
        return 2 * (1 - ellipe(m) / ellipk(m)) + force / (12 * slenderness**2) - shortening
    return 16 * ellipk(scipy.optimize.brentq(nearer, 0, 0.9)) ** 2


def buckles(push, high=0.02):
    ours = column(push, high, steps={"count": 100})
    found = ours.reaction[1:, 0] / (1e6 * 0.03 * high**3 / 12)
    shortening = 0.2 * np.arange(1, 101) / 100
    past = shortening > 0.02
    exact = np.array([elastica(s, 1 / high) for s in shortening[past]])
    error = abs(abs(found[past]) - exact).max() / exact.max()
    # Shear, which the elastica has not, takes about P / G A = 4 pi^2 E I / G A L^2 = 0.3 % off; cells of L / 100 add as much.
    return row(ours, 100, error, 1e-2, "elastica")


def snaps_through(rise=0.005):
    """A shallow arch pushed through by a thin cylinder, held against the same arch with its crown led down by a support.

    The support also pulls where the arch would go on by itself and the cylinder is left behind: it leads to where the snapped
    arch rests, and must then hold nothing. Forces are compared until the arch first leans to one side.
    """
    scene = read_scene({
        "body": {"length": 0.1, "width": 0.005, "height": 0.002, "cells": [40, 1, 2], "cell": "hexahedron"},
        "material": {"young_modulus": 1e6, "poisson_ratio": 0.3},
        "support": [{"where": "x-min z-min", "fixed": "xyz"}, {"where": "x-max z-min", "fixed": "xyz"}], "steps": {"count": 100},
        "obstacle": {"shape": "cylinder", "radius": 0.001, "path": [[0.05, 0.0025, rise + 0.003], [0.05, 0.0025, 0.001 - rise]]}})
    mesh = build_mesh(scene.body)
    mesh = replace(mesh, points=mesh.points + np.outer(rise * np.sin(np.pi * mesh.points[:, 0] / 0.1), [0, 0, 1]))
    crown = np.flatnonzero((abs(mesh.points[:, 0] - 0.05) < 1e-9) & (mesh.points[:, 2] > rise + 0.0019))
    ours = solve(scene, mesh=mesh, partial=True)
    down = tuple(ours.displacement[-1, crown].mean(axis=0))
    led = replace(scene, obstacle=None, support=(*scene.support, Support(where="crown", fixed="z", displacement=(0.0, 0.0, down[2]))))
    other = solve(led, mesh=replace(mesh, places=mesh.places | {"crown": crown}))
    assert not other.failure and not ours.reaction[-1].any()
    upright = int(min(np.flatnonzero(ours.snap)[0], np.flatnonzero(other.snap)[0]))
    force = np.interp(np.arange(upright) * (2 * rise + 0.002) / 100, np.arange(101) * -down[2] / 100, other.reaction[:, 2])
    errors = [abs(ours.reaction[:upright, 2] - force).max() / force.max(), abs(other.reaction[-1, 2]) / force.max(),
              abs(ours.displacement[-1] - other.displacement[-1]).max() / abs(down[2])]
    return row(ours, 100, max(errors), 1e-3, "crown led by a support")  # forces are read off between steps a hundredth apart


def csm1():
    """Turek and Hron's elastic bar under its weight; u of its end, over the larger component."""
    errors, solutions = [], []
    for n in (1, 2):
        scene = read_scene({
            "body": {"length": 0.35, "width": 0.02, "height": 0.01, "cells": [70 * n, 4 * n, 1], "cell": "hexahedron"},
            "material": {"law": "saint-venant-kirchhoff", "young_modulus": 1.4e6, "poisson_ratio": 0.4}, "steps": {"count": 4},
            "support": [{"where": "x-min", "fixed": "xyz"}, {"where": "z-min", "fixed": "z"}, {"where": "z-max", "fixed": "z"}],
            "load": [{"acceleration": [0.0, -2.0, 0.0]}]})
        mesh = build_mesh(scene.body)
        x, y = mesh.points[:, 0] / 0.35, mesh.points[:, 1] - 0.01
        start = np.sqrt(0.05**2 - y**2)  # the bar begins on a circle of radius 0.05 about (0, 0) and ends at x = 0.4
        mesh = replace(mesh, points=np.stack([start + (0.4 - start) * x, y, mesh.points[:, 2]], axis=1))
        solutions.append(solve(scene, mesh=mesh, partial=True))
        end = np.flatnonzero((x > 1 - 1e-9) & (abs(y) < 1e-9))
        errors.append(solutions[-1].displacement[-1, end].mean(axis=0)[:2])
    coarse, fine = errors
    best = fine + (fine - coarse) / 3
    # Richardson's extrapolation from cells of 2.5 and 5 mm: what is left is of their fourth order.
    return row(solutions[-1], 4, abs(best - [-7.187e-3, -66.10e-3]).max() / 66.10e-3, 2e-3, "Turek and Hron CSM1, extrapolated")


def pressed_block(count, poisson_ratio=0.3):
    """A quarter of a block under a sphere, small strain; the path at its end and the errors of Hertz's theory.

    Force, radius of contact a from F a^2 = 5/2 sum p r^2, and the share of the force within a radius, 1 - (1 - r^2/a^2)^(3/2).
    """
    radius, contact, side, young = 1.0, 0.06, 3.0, 1e6
    depth = contact**2 / radius
    scene = read_scene({
        "body": {"length": side, "width": side, "height": side, "cells": [count] * 3, "cell": "hexahedron"},
        "material": {"law": "linear", "young_modulus": young, "poisson_ratio": poisson_ratio}, "steps": {"count": 2},
        "support": [{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "y"}, {"where": "z-min", "fixed": "xyz"}],
        "obstacle": {"shape": "sphere", "radius": radius, "path": [[0.0, 0.0, side + radius], [0.0, 0.0, side + radius - depth]]}})
    mesh = build_mesh(scene.body)
    towards = mesh.points / side * [1, 1, -1] + [0, 0, 1]  # 0 at the contact, 1 on the far faces
    graded = np.sinh(5.2 * towards) / np.sinh(5.2) * side
    path = LoadPath(scene, replace(mesh, points=graded * [1, 1, -1] + [0, 0, side]))
    for step in (1, 2):
        state = path.advance(step / 2)
    force = state.pressure
    away = np.linalg.norm(path.balance.contact.surface.positions(path.balance.mesh.points)[:, :2], axis=1)
    exact = 4 / 3 * young / (1 - poisson_ratio**2) * radius**0.5 * depth**1.5
    order = np.argsort(away)
    share = np.cumsum(force[order]) / force.sum()
    profile = 1 - np.maximum(0, 1 - (away[order] / contact) ** 2) ** 1.5
    return path, np.array([4 * force.sum() / exact - 1, np.sqrt(2.5 * (force @ away**2) / force.sum()) / contact - 1,
                           abs(share - profile).max()])


def hertz(poisson_ratio=0.3):
    """The force extrapolated to cells of no size from two meshes, first order for the edge of contact; the rest from the finer one."""
    counts = 16, 24
    (_, coarse), (path, fine) = (pressed_block(count, poisson_ratio) for count in counts)
    first, second = (np.sinh(5.2 / count) for count in counts)
    force = fine[0] - (coarse[0] - fine[0]) * second / (first - second)
    # The far faces, 50 contact radii away, make the block stiffer than a half-space by about 1 %. A cell is 0.12 of the contact
    # radius and its force sits in its middle, so the share of the force within a radius is a staircase of steps up to 0.18.
    errors = [abs(force), abs(fine[1]), fine[2] / 9]
    return Row(2, path.halvings, path.states[-1].iterations, float(max(errors)), 2e-2, "Hertz: force, radius, pressures", "all steps")


SLOW = ("slips off sideways", "Hertz, sphere on a block", "Poisson ratio 0.49", "Poisson ratio 0.4999", "box, rounded edge",
        "distorted mesh, 30 % of a cell", "first touch at a corner")
CASES = {
    "Poisson ratio 0.49": partial(nearly_incompressible, 0.49),
    "Poisson ratio 0.499": partial(nearly_incompressible, 0.499),
    "Poisson ratio 0.4999": partial(nearly_incompressible, 0.4999),
    "slenderness 100, dead load, tip turned by 82°": dead_tip_load,
    "slenderness 100, rolled up, tip turned by 360°": rolled_up,
    "column pushed past buckling, with a small side load": partial(buckles, -1e-3),
    "the same without one": partial(buckles, 0.0),
    "shallow arch pushed through": snaps_through,
    "first touch at a corner": corner,
    "slips off the tip": slips_off_the_tip,
    "slips off sideways": slips_off_sideways,
    "ten times faster": partial(in_steps, 4),
    "the whole way in one step": partial(in_steps, 1),
    "box, rounded edge": box_edge,
    "box, sharp edge": partial(box_edge, radius=0.0),
    "two touching regions": two_regions,
    "distorted mesh, 30 % of a cell": distorted,
    "cells of aspect ratio 50": flat_cells,
    "block squeezed by half": squeezed,
    "the same in one step": squeezed_at_once,
    "Turek-Hron CSM1": csm1,
    "Hertz, sphere on a block": hertz,
}
BALL = {"shape": "sphere", "radius": 0.008, "path": [[0.05, 0.012, 0.0285], [0.05, 0.012, 0.0165]]}
PRISMS = {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [12, 4, 4], "cell": "hexahedron"}
SIBLINGS = {
    "Poisson ratio 0.499": (partial(nearly_incompressible, 0.499, obstacle=BALL), partial(nearly_incompressible, 0.499, body=PRISMS)),
    "slenderness 100, dead load, tip turned by 82°": (partial(dead_tip_load, sideways=True), partial(dead_tip_load, side=0.02)),
    "slenderness 100, rolled up, tip turned by 360°": (partial(rolled_up, high=0.005), partial(rolled_up, high=0.007)),
    "column pushed past buckling, with a small side load": (partial(buckles, 1e-2), partial(buckles, -1e-3, high=0.015)),
    "the same without one": (partial(buckles, 0.0, high=0.015), partial(buckles, 0.0, high=0.018)),
    "shallow arch pushed through": (partial(snaps_through, rise=0.0045), partial(snaps_through, rise=0.006)),
    "first touch at a corner": (partial(corner, at=(0.059, 0.001), radius=0.008, steps={"count": 40}),
                                partial(corner, at=(0.058, 0.019), radius=0.003, body=PRISMS)),
    "slips off the tip": (partial(slips_off_the_tip, slipping("cylinder", [0.057, 0.01], -0.0305)),
                          partial(slips_off_the_tip, slipping("cylinder", [0.055, 0.01], -0.0305, radius=0.008))),
    "slips off sideways": (partial(slips_off_sideways, slipping("sphere", [0.053, 0.0065], -0.0255)),
                           partial(slips_off_sideways, slipping("sphere", [0.052, 0.015], -0.0255))),
    "ten times faster": (partial(in_steps, 4, obstacle=BALL), partial(in_steps, 4, body=PRISMS)),
    "the whole way in one step": (partial(in_steps, 1, obstacle=BALL), partial(in_steps, 1, body=PRISMS)),
    "box, rounded edge": (partial(box_edge, at=0.05), partial(box_edge, size=(0.014, 0.008, 0.02))),
    "box, sharp edge": (partial(box_edge, at=0.05, radius=0.0), partial(box_edge, size=(0.014, 0.008, 0.02), radius=0.0)),
    "two touching regions": (partial(two_regions, at=0.027), partial(two_regions, wide=0.026)),
    "distorted mesh, 30 % of a cell": (partial(distorted, 1), partial(distorted, 2, body=PRISMS), partial(distorted, 3, obstacle=BALL)),
    "cells of aspect ratio 50": (partial(flat_cells, [30, 2, 3]), partial(flat_cells, [3, 30, 2])),
    "block squeezed by half": (partial(squeezed, law="neo-hookean-log"), partial(squeezed, poisson_ratio=0.2)),
    "the same in one step": (partial(squeezed_at_once, law="neo-hookean-log"), partial(squeezed_at_once, poisson_ratio=0.2)),
    "Hertz, sphere on a block": (partial(hertz, 0.0), partial(hertz, 0.45)),
}

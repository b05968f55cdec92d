"""Every hard case ends right: held against theory, another method or an invariant, to the limit that the case gives a reason for."""

from dataclasses import replace

import numpy as np
import pytest

from physics.contact.conditions import ContactSurface
from physics.contact.obstacles import Rigid
from physics.equilibrium import balance
from physics.equilibrium.path import LoadPath
from physics.mesh.build import build_mesh
from physics.solution import solve
from tests.hard_cases import CASES, SIBLINGS, SLOW, bridge, roughness
from tests.scenes import beam, pressed

SNAPS = {"column pushed past buckling, with a small side load", "the same without one", "shallow arch pushed through", "slips off the tip",
         "slips off sideways"}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in CASES])
def test_hard_case(name):
    row = CASES[name]()
    assert row.error <= row.limit
    assert row.outcome.startswith("snaps at step") if name in SNAPS else row.outcome == "all steps"


@pytest.mark.slow
@pytest.mark.parametrize(("name", "which"), [(name, which) for name, runs in SIBLINGS.items() for which in range(len(runs))])
def test_others_of_its_kind(name, which):
    """Whether it snaps is looked at where the case itself does: what it is held against holds on either side."""
    row = SIBLINGS[name][which]()
    assert row.error <= row.limit
    assert row.outcome == "all steps" or (name in SNAPS and row.outcome.startswith("snaps at step"))


def test_a_snap_is_said_and_loses_energy():
    """The end of the beam slips off: from then on it is at rest, and the frame in which that happens says so."""
    down = {"shape": "cylinder", "radius": 0.01, "path": [[0.055, 0.01, 0.0305], [0.055, 0.01, -0.0305]]}
    solution = solve(beam(obstacle=down, steps={"count": 40}))
    (step,) = np.flatnonzero(solution.snap)
    assert solution.snap[step] == pytest.approx(np.linalg.norm(solution.displacement[step - 1], axis=1).max(), rel=0.1)
    # All that was stored is lost; what the obstacle does in the part of the step before the snap is little.
    assert solution.released[step] == pytest.approx(solution.energy[step - 1], rel=1e-2) and solution.energy[step] < 1e-9
    assert not solution.reaction[step:].any() and abs(solution.displacement[step:]).max() < 1e-9
    assert f"at step {step} the body moved" in solution.model["snaps"]


def test_both_regions_of_contact_carry_their_share():
    """By symmetry half of the force each, nothing between them, and together the reaction."""
    scene = bridge()
    path = LoadPath(scene, build_mesh(scene.body))
    for step in range(1, 21):
        state = path.advance(step / 20)
    x = path.balance.contact.surface.positions(path.balance.mesh.points)[:, 0]
    left, right = state.pressure[x < 0.025].sum(), state.pressure[x > 0.035].sum()
    assert left > 0 and left == pytest.approx(right, rel=1e-2)  # the diagonals of the mesh are not quite symmetric
    assert not state.pressure[(x > 0.025) & (x < 0.035)].any()
    # Normals of the two rounded edges lean away from each other: the vertical parts add up to the reaction.
    assert 0.9 * (left + right) < state.reaction @ [0, 0, 1] <= left + right


def test_contact_is_as_good_as_exact(monkeypatch):
    """Contact ten times as stiff moves nothing by more than the penetration that is allowed, 1e-4 of a cell."""
    scene = pressed()
    ours = solve(scene)
    monkeypatch.setattr(balance, "CONTACT_STIFFNESS", 10 * balance.CONTACT_STIFFNESS)
    stiffer = solve(scene)
    assert 0 < abs(ours.displacement - stiffer.displacement).max() < 1e-4 * 0.005
    assert 5 * stiffer.penetration.max() < ours.penetration.max() < 1e-4 * 0.005


def test_an_obstacle_smaller_than_a_cell_is_not_missed():
    """A sphere 2 mm wide over the middle between the points that cells of 5 mm usually have."""
    sphere = {"shape": "sphere", "radius": 0.001, "path": [[0.05125, 0.00875, 0.0211], [0.05125, 0.00875, 0.0201]]}
    scene = beam(obstacle=sphere, steps={"count": 5})
    solution = solve(scene)
    rest = solution.mesh.points
    dense = ContactSurface(solution.mesh, "facets", np.zeros(len(rest), bool), 0.0009)
    rigid = Rigid(scene.obstacle)
    gap = rigid.gap(dense.positions(rest + solution.displacement[-1]), rigid.position(1.0))[0].min()
    # Points are an eighth of a cell apart; between four of them, 0.44 mm from each, a sphere of 1 mm goes 0.10 mm deep.
    assert solution.reaction[-1, 2] > 0 and -0.00011 < gap <= 0


def test_reaction_is_steadier_when_contact_is_felt_between_nodes():
    scene = pressed(steps={"count": 400})
    assert roughness(scene) < 0.9 * roughness(replace(scene, obstacle=replace(scene.obstacle, contact="nodes")))


@pytest.mark.parametrize("law, share", [("saint-venant-kirchhoff", 1.01 * 1.005), ("neo-hookean", None)])
def test_a_bar_without_lateral_strain_is_not_taken_for_linear(law, share):
    """Pulled by 1 %, its displacements are those of linear elasticity, its force is not: S = E e, P = (1 + 0.01) E (0.01 + 0.01^2 / 2)."""
    scene = beam(material={"law": law, "young_modulus": 1e6, "poisson_ratio": 0.0}, steps={"count": 1},
                 support=[{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "xyz", "displacement": [0.0006, 0.0, 0.0]}])
    solution = solve(scene)
    assert solution.linear_steps == 0
    if share:
        assert abs(solution.reaction[-1, 0]) == pytest.approx(share * 0.01 * 1e6 * 0.02**2, rel=1e-6)

"""Elastic modes: beam theory, rigid modes, and the properties of the pairs."""

import numpy as np
import pytest

from physics.elasticity import Elasticity
from physics.modes import elastic_modes, euler_bernoulli_hz
from physics.schema import InputError
from tests.scenes import beam

SLENDER = {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [40, 5, 5]}


def test_cantilever_of_prisms_is_near_beam_theory():
    scene = beam(body=SLENDER)
    modes = elastic_modes(scene, count=3)
    # Second-order reference 10.055 Hz in both planes; first-order prisms may be 4 % too stiff, never too soft.
    assert 10.055 < modes.frequencies_hz[0] < modes.frequencies_hz[1] < 1.04 * 10.055
    assert modes.frequencies_hz[2] == pytest.approx(45, rel=0.02)  # torsion: no hourglass mode in between
    assert modes.frequencies_hz[0] == pytest.approx(euler_bernoulli_hz(scene, 1)[0], rel=0.04)


def test_first_frequencies_of_beam_theory():
    beta = np.array([1.8751040687, 4.6940911330, 7.8547574382])
    scene = beam(body={"length": 1.0, "width": 0.01, "height": 0.02, "cells": [1, 1, 1]})
    speed, radius = np.sqrt(1e6 / 1e3), np.array([0.01, 0.02]) / np.sqrt(12)
    expected = np.sort(np.outer(radius, beta**2).ravel()) * speed / (2 * np.pi)
    assert euler_bernoulli_hz(scene, 4) == pytest.approx(expected[:4], rel=1e-9)


@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
def test_free_beam_has_six_rigid_modes_and_no_spurious_one(cell):
    scene = beam(body={**SLENDER, "cells": [20, 4, 4], "cell": cell}, support=[])
    hz = elastic_modes(scene, count=8).frequencies_hz
    # Bending of a free beam, beta L = 4.73; first-order cells, tetrahedra most of all, are stiffer than beam theory,
    # and shear makes a beam this short softer: a factor of 1.6 either way. A hourglass mode would lie far below.
    bending = (4.7300407449 / 1.8751040687) ** 2 * euler_bernoulli_hz(scene, 1)[0]
    assert max(hz[:6]) < 1e-4 * bending
    assert bending / 1.6 < hz[6] < 1.6 * bending


def test_pairs_are_pairs():
    scene = beam()
    modes = elastic_modes(scene, count=6)
    assert modes.residuals.max() < 1e-8
    assert (np.diff(modes.eigenvalues) >= 0).all()
    mesh = modes.mesh
    assert not modes.shapes[:, mesh.places["x-min"]].any()
    elasticity = Elasticity(mesh, scene.material, np.zeros(mesh.points.shape, bool))
    mass = elasticity.mass()
    right, left = mass.createVecs()
    gram = np.empty((6, 6))
    for i, phi in enumerate(modes.shapes):
        right.array[:] = elasticity.space.to_dofs(phi)
        mass.mult(right, left)
        gram[i] = [(elasticity.space.from_dofs(left.array) * psi).sum() for psi in modes.shapes]
    assert gram == pytest.approx(np.eye(6), abs=1e-8)


def test_more_modes_than_components_are_refused():
    with pytest.raises(InputError, match="free components"):
        elastic_modes(beam(body={**SLENDER, "cells": [1, 1, 1]}), count=13)


def test_memory_is_given_back():
    """A data set solves for modes in one process hundreds of times."""
    def resident():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096

    scene = beam(body=SLENDER)
    elastic_modes(scene, count=1)
    before = resident()
    for _ in range(8):
        elastic_modes(scene, count=1)
    # Stiffness and mass of this beam take 10 MB each; 8 of either would be 160 MB.
    assert resident() - before < 40e6

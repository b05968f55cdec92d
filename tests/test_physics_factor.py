"""Factors of the stiffness: all kinds solve the same, and nested dissection cuts where it may."""

import numpy as np
import pytest

from physics.body import elasticity
from physics.equilibrium.balance import Balance
from physics.equilibrium.mixing import Mixing
from physics.linalg import cholesky
from physics.linalg.cholesky import BandFactor, DissectionFactor, NotPositiveDefinite, narrowest_order
from physics.linalg.indefinite import SparseFactor
from physics.linalg.ordering.nested import dissect
from physics.mesh.build import build_mesh
from tests.scenes import beam


def factors(cell):
    scene = beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [8, 3, 3], "cell": cell})
    balance = Balance(scene, build_mesh(scene.body))
    body = balance.elasticity
    return balance, (BandFactor(body, *narrowest_order(body)), DissectionFactor(body), SparseFactor(body))


@pytest.mark.parametrize("cell", ["prism", "tetrahedron", "hexahedron"])
def test_all_factors_solve_the_same(cell):
    """The same solutions and the same compliance, held components at rest."""
    balance, made = factors(cell)
    rng = np.random.default_rng(0)
    u = np.where(balance.fixed, 0, rng.uniform(-1e-4, 1e-4, balance.fixed.shape))
    force, nodes = rng.normal(size=u.shape), np.array([3, 40, 100, 143])
    for factor in made:
        factor.update(u)
    banded, dissected, sparse = made
    solution, compliance = sparse.solve(force), sparse.compliance(nodes)
    for factor in (banded, dissected):
        assert factor.solve(force) == pytest.approx(solution, abs=1e-9 * abs(solution).max())
        assert not factor.solve(force)[balance.fixed].any()
        assert factor.compliance(nodes) == pytest.approx(compliance, abs=1e-9 * abs(compliance).max())
    assert banded.negative == dissected.negative == sparse.negative == 0
    squeezed = -0.6 * balance.mesh.points * [0, 0, 1]  # pressed flat everywhere: no state to stand still in by itself
    for factor in (banded, dissected):
        with pytest.raises(NotPositiveDefinite):
            factor.update(squeezed)
    sparse.update(squeezed)
    assert sparse.negative > 0


@pytest.mark.parametrize("kind", range(3))
def test_a_solution_in_halves_is_a_solution(kind):
    """Forces that are added between the halves, on nodes that come in one after the other, count like those from the start."""
    balance, made = factors("prism")
    factor, rng = made[kind], np.random.default_rng(1)
    factor.update(np.zeros(balance.fixed.shape))
    force = rng.normal(size=balance.fixed.shape)
    whole = factor.compliance(np.arange(0, 144, 5))
    factor.update(np.zeros(balance.fixed.shape))
    for nodes in (np.array([20, 40]), np.array([5, 20, 100]), np.array([0, 5, 75, 130])):
        push, both = rng.normal(size=(len(nodes), 3)), force.copy()
        both[nodes] += push
        begun, expected = factor.begin(force), factor.solve(force)
        assert factor.at(begun, nodes) == pytest.approx(expected[nodes], abs=1e-9 * abs(expected).max())
        assert factor.finish(begun, nodes, push) == pytest.approx(factor.solve(both), abs=1e-9 * abs(expected).max())
        columns = (3 * (nodes // 5)[:, None] + np.arange(3)).ravel()
        assert factor.compliance(nodes) == pytest.approx(whole[np.ix_(columns, columns)], abs=1e-9 * abs(whole).max())


def test_separators_separate():
    """No cell has nodes in two parts of which neither cut the other off, and every node is in one part."""
    mesh = build_mesh(beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [12, 6, 6]}).body)
    found = dissect(mesh.points, mesh.cells.astype(np.int32))
    assert sorted(found.order) == list(range(len(mesh.points)))
    part = np.repeat(np.arange(len(found.part)), found.part["own"] // 3)[found.place]
    above = [{t} for t in range(len(found.part))]
    for t in reversed(range(len(found.part))):
        if found.parent[t] >= 0:
            above[t] |= above[found.parent[t]]
    for cell in mesh.cells:
        parts = sorted(set(part[cell]))
        assert set(parts) <= above[parts[0]]


def test_numbers_of_a_dissection_grow_like_those_of_a_solid():
    """O(N^(4/3)) numbers (George 1973), where a band has O(N^(5/3)): cubes of 9^3 and 17^3 nodes."""
    numbers, nodes = [], []
    for n in (8, 16):
        mesh = build_mesh(beam(body={"length": 0.02, "width": 0.02, "height": 0.02, "cells": [n, n, n], "cell": "hexahedron"}).body)
        numbers.append(dissect(mesh.points, mesh.cells.astype(np.int32)).numbers)
        nodes.append(len(mesh.points))
    # On small meshes the surface counts: a little more than 4/3.
    assert np.log(numbers[1] / numbers[0]) / np.log(nodes[1] / nodes[0]) < 1.5


def test_mixing_solves_what_is_linear_in_as_many_steps_as_there_are_directions():
    """s(u) = A (x - u) with A = 1 but for two directions: Anderson's mixing ends where GMRES would."""
    rng = np.random.default_rng(0)
    basis = np.linalg.qr(rng.normal(size=(30, 30)))[0]
    matrix, x = basis @ np.diag([0.1, 0.3] + 28 * [1.0]) @ basis.T, rng.normal(size=30)
    mixing, u = Mixing(), np.zeros((10, 3))
    for _ in range(4):
        u, _ = mixing.next(u, (matrix @ (x - u.ravel())).reshape(10, 3), np.zeros(0))
    assert u.ravel() == pytest.approx(x, abs=1e-6)


def test_a_large_body_is_shared_by_as_many_threads_as_are_allowed(monkeypatch):
    """Small as it is, when the bounds are lowered: the same solution in both, and in its forces, to the last bit."""
    scene, found = beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [8, 3, 3]}), {}
    for allowed, least in (("1", 0), ("2", 10**9), ("2", 0), ("3", 0)):
        monkeypatch.setenv("OMP_NUM_THREADS", allowed)
        monkeypatch.setattr(cholesky, "SHARED", least)
        monkeypatch.setattr(elasticity, "SHARED", least)
        body = Balance(scene, build_mesh(scene.body)).elasticity
        factor, u = DissectionFactor(body), np.where(body.fixed, 0, 1e-4 * np.sin(np.arange(body.fixed.size)).reshape(-1, 3))
        threads = 1 if least else int(allowed)
        assert len(factor._panels._shares.blas) == len(body._parts[0][0]._ranges) == threads
        factor.update(u)
        found[allowed, least] = factor.solve(np.cos(u)).tobytes(), body.force(u).tobytes()
    assert len(found) == 4 and len(set(found.values())) == 1

"""Block Lanczos with the own factor: against scipy's dense solver, closed forms, and SLEPc with MUMPS."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from physics.linalg.eigen import direct
from physics.linalg.eigen.dissected import WIDTH, BlockLanczos, fits
from physics.linalg.eigen.krylov import largest_pairs
from physics.linalg.eigen.lowest import lowest_pairs
from physics.mesh.build import build_mesh
from physics.modes.elastic import elastic_problem
from physics.scene import read_scene
from tests.test_physics_eigen import chain, problem

OWN, SLEPC = "block Lanczos", "Krylov-Schur"
SPACES = []  # kept: on Debian 13 the matrices of a space that is gone cannot be used


def solid(cells, *, held=True, extent=(0.1, 0.02, 0.02), **body):
    """The problem of a beam, its section a square."""
    length, width, height = extent
    scene = read_scene({"body": {"length": length, "width": width, "height": height, "cells": cells, "cell": "hexahedron", **body},
                        "material": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7000.0},
                        "support": [{"where": "x-min"}] if held else []})
    found, space = elastic_problem(scene, build_mesh(scene.body))
    SPACES.append(space)
    return found


def chains(copies, nodes, stiffness=None):
    """Chains of nodes, each with three equal components: every value 3 times the copies of its stiffness."""
    K = scipy.linalg.block_diag(*(np.kron(chain(nodes, stiffness=k), np.eye(3)) for k in stiffness or [1.0] * copies))
    points = np.array([(x, 3.0 * copy, 0.0) for copy in range(copies) for x in range(nodes)])
    first = np.concatenate([nodes * copy + np.arange(nodes - 1) for copy in range(copies)])
    return K, (points, np.stack([first, first + 1], axis=1).astype(np.int32))


def own(case, count):
    return direct._lowest(BlockLanczos(case), case, count, int(case.free.sum()))


def dense(matrix, free):
    return matrix[:, :][np.ix_(free, free)]


@pytest.mark.parametrize("body", [{}, {"order": 2}, {"cell": "tetrahedron"}, {"cell": "prism"}])
@pytest.mark.parametrize("held", [True, False])
def test_the_same_pairs_as_by_slepc_and_by_dense_algebra(body, held):
    case = solid([7, 3, 3] if "order" in body else [13, 5, 5], held=held, **body)
    pairs, others = lowest_pairs(case, 10), lowest_pairs(replace(case, graph=None), 10)
    assert pairs.solver.startswith(OWN) and others.solver.startswith(SLEPC)
    K, M = dense(case.stiffness, case.free), dense(case.mass, case.free)
    exact = scipy.linalg.eigh(K, M, eigvals_only=True, subset_by_index=[0, 9])
    zeros = 0 if held else 6
    assert pairs.zeros == others.zeros == zeros and pairs.counted
    assert abs(pairs.values[:zeros]).max(initial=0.0) < 1e-8 * exact[6]
    # Eigenvalues have an error of the square of what vectors have; a dense solver's rounding is eps times the largest.
    assert pairs.values[zeros:] == pytest.approx(others.values[zeros:], rel=1e-10)
    assert pairs.values[zeros:] == pytest.approx(exact[zeros:10], rel=1e-7)
    assert pairs.beyond == pytest.approx(others.beyond, rel=1e-9)
    x = pairs.vectors[:, case.free]
    assert not pairs.vectors[:, ~case.free].any()
    assert x @ M @ x.T == pytest.approx(np.eye(10), abs=1e-10)
    scales = np.where(np.arange(10) < zeros, exact[zeros], pairs.values)
    residuals = [np.linalg.norm(K @ v - s * (M @ v)) / (r * np.linalg.norm(M @ v)) for v, s, r in zip(x, pairs.values, scales, strict=True)]
    assert pairs.residuals == pytest.approx(residuals, rel=0.1, abs=3e-10) and max(residuals) < 1e-8
    # Bending of a square section comes in twos, in whatever axes: what they span is the same.
    span, other = pairs.vectors[zeros:zeros + 2], others.vectors[zeros:zeros + 2]
    assert abs(np.linalg.svd(span[:, case.free] @ M @ other[:, case.free].T, compute_uv=False) - 1).max() < 1e-8


@pytest.mark.parametrize("count", [2, 12, 13, 20])
def test_more_copies_than_a_block_has_vectors_are_all_found_and_counted(count):
    """Every value 12 times, which a block of eight cannot tell: the inertia says how many are missing."""
    K, graph = chains(4, 40)
    pairs = own(problem(K, np.eye(len(K)), graph=graph), count)
    exact = np.repeat(2 - 2 * np.cos(np.arange(1, 41) * np.pi / 41), 12)
    assert WIDTH < 12
    assert pairs.values == pytest.approx(exact[:count], rel=1e-10)
    assert pairs.beyond == pytest.approx(exact[count], rel=1e-8)
    assert pairs.vectors @ pairs.vectors.T == pytest.approx(np.eye(count), abs=1e-8)
    assert pairs.counted


def test_a_pair_that_a_search_leaves_out_is_found(monkeypatch):
    """A search that leaves out the third pair is found out by the count, and the pair by a second search."""
    K, graph = chains(2, 60, [1.0, 1.7])
    K[:3, :3] += np.diag([0.0, 0.1, 0.2])  # three lowest values that differ
    case = problem(K, np.eye(len(K)), graph=graph)
    values, vectors = scipy.linalg.eigh(K)
    searched = []
    real = BlockLanczos.lowest

    def blind(self, wanted, good, shift, known=None):
        searched.append(wanted)
        if known is not None:
            return real(self, wanted, good, shift, known)
        found, rows = real(self, wanted + 1, good + 1, shift)
        return np.delete(found, 2), np.delete(rows, 2, axis=0)

    monkeypatch.setattr(BlockLanczos, "lowest", blind)
    pairs = own(case, 5)
    assert searched == [6, 1] and pairs.counted
    assert pairs.values == pytest.approx(values[:5], rel=1e-10)
    assert abs((pairs.vectors[:3] * vectors.T[:3]).sum(axis=1)) == pytest.approx(np.ones(3), abs=1e-7)


def test_the_count_below_a_bound_is_that_of_the_spectrum():
    case = solid([9, 3, 3], extent=(0.1, 0.02, 0.03))
    values = scipy.linalg.eigh(dense(case.stiffness, case.free), dense(case.mass, case.free), eigvals_only=True)
    inverse = BlockLanczos(case)
    for number in (0, 1, 2, 7, 50, 200, len(values) // 2, len(values) - 1):
        gap = (values[number] - values[number - 1]) / 2 if number else values[0] / 2
        assert inverse.below(values[number] - gap, gap) == number
    assert inverse.below(2 * values[-1], values[-1]) == len(values)
    assert inverse.below(-values[0], values[0]) == 0
    with pytest.raises(ArithmeticError, match="nearly singular"):  # nearer than rounding: eps times the largest value
        inverse.below(values[3], 1e-16 * values[-1])


def test_no_count_where_a_part_is_singular():
    """A leaf of an odd number of nodes of a chain has the eigenvalue 2, as no chain of 40 nodes has."""
    K, graph = chains(1, 40)
    inverse = BlockLanczos(problem(K, np.eye(len(K)), graph=graph))
    own = inverse._panels.dissection.part["own"] // 3
    assert (own[inverse._panels.dissection.part["last"] == inverse._panels.dissection.part["child"]] % 2).any()
    exact = 2 - 2 * np.cos(np.arange(1, 41) * np.pi / 41)
    with pytest.raises(ArithmeticError, match="singular"):
        inverse.below(2.0, abs(exact - 2).min())
    assert inverse.below(1.9, 0.01) == 3 * (exact < 1.9).sum()


def test_eight_right_sides_are_solved_for_as_one_is():
    case = solid([9, 3, 3])
    inverse = BlockLanczos(case)
    K, M = dense(case.stiffness, case.free), dense(case.mass, case.free)
    right = np.random.default_rng(0).normal(size=(11, len(case.free)))
    for shift in (0.0, -1e6):
        left = inverse.solve(right, shift)
        assert not left[:, ~case.free].any()
        exact = np.linalg.solve(K - shift * M, right[:, case.free].T).T
        assert left[:, case.free] == pytest.approx(exact, rel=1e-8, abs=1e-9 * abs(exact).max())


def test_thin_bodies_are_refined_beyond_double_precision():
    case = solid([300, 1, 1], extent=(1.0, 0.004, 0.004))
    pairs, others = lowest_pairs(case, 4), lowest_pairs(replace(case, graph=None), 4)
    assert pairs.solver.startswith(OWN) and "refined in extended precision" in pairs.solver
    assert pairs.floor > 1e-8 > pairs.residuals.max()
    assert pairs.values == pytest.approx(others.values, rel=1e-8)


def test_what_the_own_factor_cannot_do_mumps_does():
    K, graph = chains(3, 130)
    case = problem(K, np.eye(len(K)), graph=graph)
    assert lowest_pairs(case, 3).solver.startswith(OWN)
    K[0, -1] = K[-1, 0] = 0.5  # of nodes that have no cell in common
    with pytest.raises(ValueError, match="no cell in common"):
        BlockLanczos(problem(K, np.eye(len(K)), graph=graph))
    pairs = lowest_pairs(problem(K, np.eye(len(K)), graph=graph), 3)
    assert pairs.solver.startswith(SLEPC)
    assert pairs.values == pytest.approx(np.linalg.eigvalsh(K)[:3], rel=1e-9)
    K, graph = chains(3, 130)
    K -= 1e-3 * np.eye(len(K))  # unstable
    pairs = lowest_pairs(problem(K, np.eye(len(K)), graph=graph), 3)
    assert pairs.solver.startswith(SLEPC)


def test_few_unknowns_are_left_to_slepc():
    assert not fits(solid([8, 3, 3]), 11, 384)
    assert lowest_pairs(solid([8, 3, 3]), 10).solver.startswith(SLEPC)
    assert not fits(replace(solid([13, 5, 5]), graph=None), 11, 1404)


def test_the_same_bits_each_time():
    case = solid([13, 5, 5])
    first, second = (lowest_pairs(case, 8) for _ in range(2))
    assert np.array_equal(first.values, second.values) and np.array_equal(first.vectors, second.vectors)


@pytest.mark.parametrize("room", [60, 24])
def test_pairs_of_an_inverse_are_corrected_by_one_more_step(room):
    """The largest value is a million times the lowest: A times a vector good to 1e-9 would be wrong by up to 1e-3. With little room the
    basis shrinks on the way."""
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(300, 300)))[0]
    values = np.concatenate([[1.0, 1.0, 1.3, 2.0, 2.1, 2.1, 2.1, 4.0], 6 * 1.042 ** np.arange(292)])
    assert 5e5 < values[-1] < 2e6
    root = np.sqrt(np.linspace(1.0, 3.0, 300))
    A, M = (root[:, None] * turn * values) @ (turn.T * root), np.diag(root**2)
    half = turn / root[:, None]  # A^-1 = half values^-1 half^T
    maps = (lambda y: (half / values) @ (half.T @ y)), (lambda y: M @ y)
    theta, x, steps = largest_pairs(*maps, rng.normal(size=(300, 4)), wanted=9, good=8, tolerance=2e-9, room=room)
    assert 1 / theta[:8] == pytest.approx(values[:8], rel=1e-9) and len(theta) >= 9
    assert x @ M @ x.T == pytest.approx(np.eye(len(x)), abs=1e-9)
    right = M @ x[:8].T / theta[:8]
    assert (np.linalg.norm(A @ x[:8].T - right, axis=0) / np.linalg.norm(right, axis=0)).max() < 1e-8
    assert steps <= {60: 20, 24: 30}[room]
    known = theta[[0, 3]], x[[0, 3]]
    more, y, _ = largest_pairs(*maps, rng.normal(size=(300, 4)), wanted=8, good=8, tolerance=2e-9, room=60, known=known)
    assert 1 / more[:8] == pytest.approx(values[:8], rel=1e-9)
    assert y @ M @ y.T == pytest.approx(np.eye(len(y)), abs=1e-9)

"""Eigenpairs of small matrices: against scipy's dense solver, closed forms, and the definitions written out."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from petsc4py import PETSc

from physics.linalg.eigen import direct, lowest
from physics.linalg.eigen import pairs as eigen
from physics.linalg.eigen.lowest import lowest_pairs
from physics.linalg.eigen.pairs import Problem, clusters

EPS = np.finfo(float).eps


def petsc(dense, like=None):
    """A sparse matrix, with the pattern of another one: stiffness and mass of elements have the same."""
    rows = scipy.sparse.csr_matrix(dense if like is None else like)
    if like is not None:
        rows.data[:] = np.asarray(dense)[rows.nonzero()]
    matrix = PETSc.Mat().createAIJ(rows.shape, csr=(rows.indptr, rows.indices, rows.data), comm=PETSc.COMM_SELF)
    matrix.assemble()
    return matrix


def problem(K, M, **changes):
    n = len(K)
    return Problem(**({"stiffness": petsc(K), "mass": petsc(M, like=K), "free": np.ones(n, bool), "zeros": 0, "scale": 1.0, "dimension": 3,
                       "near_null": np.ones((1, n))} | changes))


def chain(n, *, held=True, stiffness=1.0):
    """Springs in a row: eigenvalues (2 - 2 cos(k pi / (n + 1))) of the held one, k = 1 .. n; of a free one n for n + 1."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    if not held:
        K[0, 0] = K[-1, -1] = 1
    return stiffness * K


def spd(n, seed):
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(n, n))
    return half @ half.T + n * np.eye(n) * 0.1, np.eye(n) * 3 + 0.1 * (half + half.T) / np.sqrt(n)


def check(pairs, K, M, free, count, *, scale=None):
    """Values, orthonormal vectors, residuals and what comes next, by scipy on the free rows and columns."""
    keep = np.flatnonzero(free)
    K, M = K[np.ix_(keep, keep)], M[np.ix_(keep, keep)]
    values = scipy.linalg.eigh(K, M, eigvals_only=True)
    top = values[-1]
    assert pairs.values == pytest.approx(values[:count], rel=1e-9, abs=1e-12 * top)
    assert pairs.vectors.shape == (count, len(free)) and not pairs.vectors[:, ~free].any()
    x = pairs.vectors[:, keep]
    assert x @ M @ x.T == pytest.approx(np.eye(count), abs=1e-7)
    scales = np.where(abs(values[:count]) < 1e-10 * top, scale or 0, values[:count])
    residuals = [np.linalg.norm(K @ v - s * (M @ v)) / (r * np.linalg.norm(M @ v))
                 for v, s, r in zip(x, pairs.values, scales, strict=True)]
    # These are near rounding, where only their size is sure.
    assert pairs.residuals.max() < 1e-8 and max(residuals) < 1e-8
    if count < len(values):
        assert pairs.beyond == pytest.approx(values[count], rel=1e-6)
    return values


@pytest.mark.parametrize("method", ["direct", "multigrid"])
def test_held_unknowns_play_no_part(method):
    K, M = spd(40, 0)
    free = np.random.default_rng(1).random(40) > 0.3
    pairs = lowest_pairs(problem(K, M, free=free), 5, method=method)
    values = check(pairs, K, M, free, 5)
    assert pairs.zeros == 0
    ratio = (np.diag(K) / np.diag(M))[free].max()
    assert pairs.floor == pytest.approx(EPS * ratio / values[0], rel=1e-6)
    assert pairs.counted == (method == "direct")
    name = {"direct": "factor by MUMPS", "multigrid": "Davidson"}[method]
    assert name in pairs.solver and f"({free.sum()} unknowns in 3-D, at most 150000)" in pairs.solver and ", shift -" not in pairs.solver


def test_the_way_is_chosen_by_the_number_of_free_unknowns_and_the_dimension(monkeypatch):
    monkeypatch.setattr(lowest, "DIRECT", {2: 29, 3: 30})
    K, M = spd(33, 0)
    free = np.arange(33) > 2
    solid, plane = (lowest_pairs(problem(K, M, free=free, dimension=dimension), 2).solver for dimension in (3, 2))
    assert "MUMPS" in solid and "(30 unknowns in 3-D, at most 30)" in solid
    assert "multigrid" in plane and "(30 unknowns in 2-D, more than 29)" in plane
    assert "MUMPS" in lowest_pairs(problem(K, M, free=free, dimension=2), 2, method="direct").solver


@pytest.mark.parametrize("scale", [0.2, 1e4, 1e-3])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_body_of_two_pieces_free_to_move_has_two_zeros(scale, count):
    """Whatever it was told of the size of the first value above: the shift follows the one that is found."""
    K = scipy.linalg.block_diag(chain(9, held=False), chain(14, held=False, stiffness=1.7))
    M = np.diag(np.linspace(1.0, 2.0, 23))
    pairs = lowest_pairs(problem(K, M, zeros=2, scale=scale), count)
    first = scipy.linalg.eigh(K, M, eigvals_only=True)[2]
    assert pairs.zeros == min(count, 2)
    assert abs(pairs.values[:2]).max() < 1e-10
    if count > 1:
        check(pairs, K, M, np.ones(23, bool), count, scale=first)
    assert "shift -" in pairs.solver
    shift = -float(pairs.solver.split("shift -")[1].split()[0].strip(",)"))
    if count > 2:  # a scale a thousand times too small does no harm
        assert shift == pytest.approx(-first / 10 if scale == 1e4 else -scale / 10, rel=0.01)
        assert pairs.floor == pytest.approx(EPS * (np.diag(K) / np.diag(M)).max() / first, rel=1e-6)
        assert pairs.counted


def test_zeros_that_nobody_expects_are_found_and_missing_ones_are_an_error():
    K, M = chain(12, held=False), np.eye(12) * 2
    pairs = lowest_pairs(problem(K, M, scale=0.03), 3)
    assert pairs.zeros == 1 and "shift -0.003" in pairs.solver
    check(pairs, K, M, np.ones(12, bool), 3, scale=1 - np.cos(np.pi / 12))
    with pytest.raises(RuntimeError, match=r"1 zero eigenvalues found where the supports leave 3: the lowest are .*, 0\.0341, 0\.134$"):
        lowest_pairs(problem(K, M, scale=0.03, zeros=3), 3)
    with pytest.raises(RuntimeError, match="1 zero eigenvalues found where the supports leave 2"):
        lowest_pairs(problem(K, M, scale=0.03, zeros=2), 2)
    assert lowest_pairs(problem(K, M, scale=0.03, zeros=2), 1).zeros == 1


@pytest.mark.parametrize("count", [1, 2, 4, 5, 7, 10, 48])
def test_copies_are_all_found_and_counted(count):
    """Four equal chains and one twice as stiff, in an order that hides it: every value four times or more."""
    K = scipy.linalg.block_diag(np.kron(chain(8), np.eye(4)), chain(8, stiffness=2), chain(8, stiffness=4))
    order = np.random.default_rng(0).permutation(48)
    K = K[np.ix_(order, order)]
    pairs = lowest_pairs(problem(K, np.eye(48)), count)
    exact = np.sort(np.outer([1, 1, 1, 1, 2, 4], 2 - 2 * np.cos(np.arange(1, 9) * np.pi / 9)).ravel())
    assert pairs.values == pytest.approx(exact[:count], rel=1e-9)
    assert pairs.vectors @ pairs.vectors.T == pytest.approx(np.eye(count), abs=1e-7)
    if count == 48:
        assert np.isnan(pairs.beyond) and pairs.counted
    else:
        assert pairs.beyond == pytest.approx(exact[count], rel=1e-6)
        assert pairs.counted == (count > 1)


def test_a_value_that_goes_on_as_far_as_was_looked_is_said_not_to_be_counted():
    values = np.array([1.0] + 40 * [2.0] + [3.0])
    pairs = lowest_pairs(problem(np.diag(values), np.eye(42)), 3)
    assert pairs.values == pytest.approx([1, 2, 2], rel=1e-9) and pairs.beyond == pytest.approx(2)


def test_the_bending_of_a_fine_beam_is_refined_beyond_double_precision():
    """T^2 of the chain T: values (2 - 2 cos(k pi / (n + 1)))^2, the first 1e-9 of the last: double precision leaves 1e-7."""
    n = 300
    T = chain(n)
    K, exact = T @ T, (2 - 2 * np.cos(np.arange(1, n + 1) * np.pi / (n + 1))) ** 2
    pairs = lowest_pairs(problem(5 * K, 2 * np.eye(n), scale=exact[0]), 4)
    assert pairs.solver.startswith("Krylov-Schur") and "refined in extended precision" in pairs.solver
    # The last digits of 64 bits, times the last value over the first: 5e-20 x 1e9.
    assert pairs.values == pytest.approx(2.5 * exact[:4], rel=2e-10)
    assert 0 < pairs.residuals.min() and pairs.residuals.max() < 1e-8
    shape = np.sin(np.outer(np.arange(1, 5), np.arange(1, n + 1)) * np.pi / (n + 1))
    shape *= np.sqrt(1 / (n + 1)) * np.sign((shape * pairs.vectors).sum(axis=1))[:, None]  # phi . 2 phi = 1
    np.testing.assert_allclose(pairs.vectors, shape, atol=1e-10)
    assert pairs.floor == pytest.approx(EPS * 6 / exact[0], rel=1e-6)  # the largest entry on the diagonal is 6


def grid(nx, ny, *, held):
    """The five-point Laplacian of nx x ny unknowns, its spacing twice as wide along y."""
    return np.kron(chain(nx, held=held), np.eye(ny)) + np.kron(np.eye(nx), chain(ny, held=held)) / 4


@pytest.mark.parametrize("zeros", [0, 1])
def test_multigrid_finds_what_a_factor_finds(zeros):
    K = 3e4 * grid(14, 9, held=not zeros)
    M = np.diag(7e-3 * np.linspace(1, 2, 126))
    free = np.ones(126, bool)
    if not zeros:
        free[[0, 5, 77]] = False
    exact = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], eigvals_only=True)
    pairs = lowest_pairs(problem(K, M, free=free, zeros=zeros, scale=exact[zeros], dimension=2), 6, method="multigrid")
    check(pairs, K, M, free, 6, scale=exact[zeros])
    assert pairs.zeros == zeros and not pairs.counted
    assert pairs.solver.startswith("LOBPCG (") and "of 4) with algebraic multigrid" in pairs.solver
    assert pairs.floor == pytest.approx(EPS * (np.diag(K) / np.diag(M))[free].max() / exact[zeros], rel=1e-6)
    few = lowest_pairs(problem(K, M, free=free, zeros=zeros, scale=exact[zeros], dimension=2), 6, method="direct")
    assert pairs.values[zeros:] == pytest.approx(few.values[zeros:], rel=1e-9)


def test_zeros_are_below_ten_times_the_noise_or_a_small_share_of_the_scale():
    values = np.array([-9e-9, 2e-9, 9.9e-9, 1.1e-8, 0.5])
    is_zero, reference = eigen.which_are_zero(values, 1e-9, 2.0, False)
    assert is_zero.tolist() == [True, True, True, False, False] and reference == 1.1e-8
    is_zero, reference = eigen.which_are_zero(values, 1e-9, -3.0, True)  # 3e-8 is more than 1e-8, ten times the noise
    assert is_zero.tolist() == [True, True, True, True, False] and reference == 0.5
    assert eigen.which_are_zero(values, 1e-9, -0.5, True)[0].tolist() == [True, True, True, False, False]
    assert eigen.which_are_zero(np.array([3.0, np.nan, 0.0]), 0.0, 1.0, False)[0].tolist() == [False, True, True]
    assert eigen.which_are_zero(np.zeros(2), 1e-9, -3.0, True)[1] == 3.0


def test_residuals_are_what_is_missing_over_scale_and_inertia():
    K, M = spd(5, 3)
    rng = np.random.default_rng(4)
    vectors, values, scales = rng.normal(size=(2, 5)), np.array([0.7, -1.9]), np.array([2.0, 5.0])
    rows = [PETSc.Vec().createWithArray(row.copy(), comm=PETSc.COMM_SELF) for row in vectors]
    expected = [np.linalg.norm(K @ x - value * M @ x) / (scale * np.linalg.norm(M @ x))
                for x, value, scale in zip(vectors, values, scales, strict=True)]
    assert eigen.residuals_of(petsc(K), petsc(M), values, rows, scales) == pytest.approx(expected, rel=1e-12)
    wide = direct._extended(petsc(K)) @ vectors[0].astype(np.longdouble)
    assert wide.dtype == np.longdouble and wide.astype(float) == pytest.approx(K @ vectors[0], rel=1e-14)
    K = np.diag([2.0, 9.0, 8.0])
    assert eigen.largest(petsc(K), petsc(np.diag([1.0, 3.0, 2.0]))) == 4.0


def test_clusters_are_runs_of_neighbours_and_the_zeros_one_of_their_own():
    assert clusters(np.array([3.0, 3.06, 8, 8.16, 8.33])) == (range(0, 2), range(2, 4), range(4, 5))  # 0.17 of 8.33 is not within
    assert clusters(np.array([-1e-9, 0, 1e-6, 5, 5, 9]), 3) == (range(0, 3), range(3, 5), range(5, 6))
    assert clusters(np.array([4.9, 5, 5]), 2) == (range(0, 2), range(2, 3))  # what is zero is said, not guessed
    assert clusters(np.array([1.0, 1.02, 1.0406, 1.063])) == (range(0, 3), range(3, 4))  # 2 % of the upper one
    assert clusters(np.array([7.0])) == (range(0, 1),)
    assert clusters(np.array([0.0, 0.0]), 2) == (range(0, 2),)


def test_the_problem_is_left_as_it_was():
    K, M = spd(12, 5)
    free = np.arange(12) > 1
    case = problem(K, M, free=free)
    for method in ("direct", "multigrid"):
        lowest_pairs(case, 2, method=method)
        assert case.stiffness[:, :] == pytest.approx(K, abs=0) and case.mass[:, :] == pytest.approx(M, abs=0)
    lowest_pairs(replace(case, free=np.ones(12, bool)), 2)
    assert case.stiffness[:, :] == pytest.approx(K, abs=0)

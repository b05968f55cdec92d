"""The loops over cells: sums over sample points, nodes and cells in plain loops, whatever does not fill a pack."""

import numpy as np
import pytest

from physics.body.element import Samples
from physics.body.kernel import Kernel, _packs

LAME = 3.0, 2.0


def hooke(H, lmbda, mu):
    """Energy density and stress of small strain; H the gradient of the displacement."""
    e = (H + H.T) / 2
    return lmbda / 2 * np.trace(e) ** 2 + mu * (e * e).sum(), lmbda * np.trace(e) * np.eye(3) + 2 * mu * e


def by_loops(cells, samples, u):
    """W_c = sum_p V_p W(F_p), f_a = sum_p V_p P g_ap and K_ab = sum_p V_p g_ap . A . g_bp, each law's part by its share."""
    nodes, n = len(u), cells.shape[1]
    energy, force, stiffness = np.zeros(len(cells)), np.zeros((nodes, 3)), np.zeros((len(cells), 3 * n, 3 * n))
    for c, cell in enumerate(cells):
        for p, (share_l, share_m) in enumerate(samples.parts):
            lmbda, mu = LAME[0] * share_l, LAME[1] * share_m
            g, V = samples.gradients[p, c], samples.volumes[p, c]
            W, P = hooke(sum(np.outer(u[node], g[a]) for a, node in enumerate(cell)), lmbda, mu)
            energy[c] += V * W
            for a, node in enumerate(cell):
                force[node] += V * P @ g[a]
            for column in range(3 * n):
                b, k = divmod(column, 3)
                _, P = hooke(np.outer(np.eye(3)[k], g[b]), lmbda, mu)  # linear: the stress of a unit displacement
                for a in range(n):
                    stiffness[c, 3 * a:3 * a + 3, column] += V * P @ g[a]
    return energy, force, stiffness


@pytest.mark.parametrize("count", [1, 8, 11])
def test_sums_over_points_nodes_and_cells(count):
    """Six nodes a cell, four points with different shares of lambda and mu, other gradients and volumes at every one."""
    rng = np.random.default_rng(count)
    cells = np.stack([rng.permutation(9)[:6] for _ in range(count)])
    samples = Samples(rng.normal(size=(4, count, 6, 3)), rng.uniform(0.5, 2, (4, count)),
                      np.array([(1.0, 1.0), (0.5, 0.0), (0.0, 2.0), (0.2, 0.3)]))
    u = rng.normal(size=(9, 3))
    energy, force, stiffness = by_loops(cells, samples, u)
    kernel = Kernel("linear", cells, samples)
    np.testing.assert_allclose(kernel.energies(u, LAME), energy, rtol=1e-12)
    np.testing.assert_allclose(kernel.forces(u, LAME), force, rtol=0, atol=1e-12 * abs(force).max())
    slot = rng.permutation(count * 171).reshape(count, 171).astype(np.int32)
    out = np.ones(count * 171)  # it adds to what is there
    kernel.add_stiffness(u, LAME, slot, out)
    rows, columns = np.triu_indices(18)
    np.testing.assert_allclose(out[slot] - 1, stiffness[:, rows, columns], rtol=0, atol=1e-12 * abs(stiffness).max())
    together = np.zeros(1)  # all into one place
    kernel.add_stiffness(u, LAME, np.zeros((count, 171), np.int32), together)
    assert together[0] == pytest.approx(stiffness[:, rows, columns].sum(), rel=1e-10)
    transposed = np.asfortranarray(u)  # another layout in memory of the same displacements
    assert np.array_equal(kernel.energies(transposed, LAME), kernel.energies(u, LAME))
    with pytest.raises(AssertionError):
        kernel.add_stiffness(u, LAME, slot[:, :170], out)


@pytest.mark.parametrize("lanes", [8, 4, 2])
def test_packs_hold_cells_side_by_side_gradients_first_then_the_volume(lanes):
    count, points, n = 11, 2, 4
    gradients = np.arange(points * count * n * 3, dtype=float).reshape(points, count, n, 3)
    volumes = 1000.0 + np.arange(points * count).reshape(points, count)
    packs = _packs(Samples(gradients, volumes, np.ones((2, 2))), lanes)
    assert packs.shape == (-(-count // lanes), 2, 13, lanes) and packs.ctypes.data % 64 == 0
    for c in range(len(packs) * lanes):
        for p in range(points):
            expected = [*gradients[p, c].ravel(), volumes[p, c]] if c < count else [0] * 13
            assert packs[c // lanes, p, :, c % lanes].tolist() == expected


@pytest.mark.parametrize("threads", [2, 3, 7])
@pytest.mark.parametrize("count", [1, 30, 61])
def test_threads_that_share_the_cells_give_the_bits_of_one(threads, count):
    """Nodes at random, so that most belong to several threads; added to forces that are there; many times over."""
    rng = np.random.default_rng(count)
    cells = np.stack([rng.permutation(20)[:6] for _ in range(count)])
    samples = Samples(rng.normal(size=(2, count, 6, 3)), rng.uniform(0.5, 2, (2, count)), np.ones((2, 2)))
    u, there = rng.normal(size=(2, 23, 3))  # three nodes are of no cell
    one, several = Kernel("linear", cells, samples), Kernel("linear", cells, samples, threads=threads)
    expected = one.forces(u, LAME, there.copy())
    assert expected - there == pytest.approx(by_loops(cells, samples, u)[1], abs=1e-11 * abs(expected).max())
    for _ in range(10):
        assert np.array_equal(several.forces(u, LAME, there.copy()), expected)
    assert np.array_equal(several.forces(u, LAME), one.forces(u, LAME))

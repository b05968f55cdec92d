"""The smallest trajectory with everything in it: two tetrahedra, held at two nodes, and an obstacle of two triangles.

Far from the origin, three axes of different size, displacements as large as the cells, held nodes that move. Every number is a
multiple of 1/256, so that single precision holds it exactly. And the frames' graphs from their definition, in plain loops.
"""

from itertools import combinations

import numpy as np

from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE, Trajectory

REST = np.array([[3.0, -2.0, 5.0], [3.5, -1.875, 5.125], [3.125, -1.25, 5.25], [3.25, -1.75, 6.0], [4.0, -1.125, 5.875],  # the body
                 [4.5, -1.375, 6.25], [5.0, -1.0, 6.125], [4.625, -0.75, 6.75], [4.25, -1.125, 7.0]])
KIND = np.array([HANDLE, NORMAL, HANDLE, NORMAL, NORMAL, OBSTACLE, OBSTACLE, OBSTACLE, OBSTACLE], np.uint8)
CELLS = ((0, 1, 2, 3), (1, 2, 3, 4), (5, 6, 7), (5, 7, 8))


def tiny(steps: int = 4, seed: int = 0) -> Trajectory:
    """Frame 0 is at rest; each later one is as its own dice fell, 0.5, 0.3 and 0.2 m wide along the axes."""
    motion = np.random.default_rng(seed).normal(size=(steps + 1, 9, 3)) * [0.5, 0.3, 0.2]
    motion[:, 5:] = motion[:, 5:6] * 2  # the obstacle is rigid
    motion[0] = 0
    return Trajectory(points=REST, connectivity=np.concatenate(CELLS), offsets=np.cumsum([0, 4, 4, 3, 3]),
                      types=np.array([10, 10, 5, 5], np.uint8), node_kind=KIND,
                      displacement=(np.round(motion * 256) / 256).astype(np.float32), modes=np.zeros((0, 9, 3), np.float32))


def one_cell(steps: int = 2) -> Trajectory:
    """Another size of graph: the first tetrahedron alone, nothing held, no obstacle."""
    whole = tiny(steps, seed=1)
    return Trajectory(points=REST[:4] * [1, 2, 3], connectivity=np.arange(4), offsets=np.array([0, 4]), types=np.array([10], np.uint8),
                      node_kind=np.zeros(4, np.uint8), displacement=whole.displacement[:, :4], modes=np.zeros((0, 4, 3), np.float32))


def edges_by_hand() -> list[tuple[int, int]]:
    """Every (sender, receiver) along the cells, sorted by receiver: all corners of a triangle or tetrahedron are joined."""
    found = {pair for cell in CELLS for a, b in combinations(cell, 2) for pair in ((a, b), (b, a))}
    return sorted(found, key=lambda pair: (pair[1], pair[0]))


def node_by_hand(rest, x, velocity, known, kind, i):
    """The 12 features of node i: its kind (free, obstacle, held), a velocity, its place from the held nodes, its displacement."""
    held = [rest[j] for j in range(len(kind)) if kind[j] == HANDLE]
    origin = sum(held) / len(held)
    one_hot = [float(kind[i] == NORMAL), float(kind[i] == OBSTACLE), float(kind[i] == HANDLE)]
    return [*one_hot, *(known[i] if kind[i] == NORMAL else velocity[i]), *(rest[i] - origin), *(x[i] - rest[i])]


def mesh_edge_by_hand(rest, x, s, r):
    """The 8 features of the mesh edge from s to r: X, |X|, x - X, |x| - |X|."""
    before, after = rest[s] - rest[r], x[s] - x[r]
    long, now = sum(before**2) ** 0.5, sum(after**2) ** 0.5
    return [*before, long, *(after - before), now - long]


def contacts_by_hand(x, kind, radius):
    """Pairs (sender, receiver) of an obstacle node and one of the body within a radius, sorted by receiver, and their features."""
    pairs = [(s, r) for r in range(len(x)) for s in range(len(x))
             if (kind[s] == OBSTACLE) != (kind[r] == OBSTACLE) and sum((x[s] - x[r]) ** 2) ** 0.5 <= radius]
    return pairs, [[*(x[s] - x[r]), sum((x[s] - x[r]) ** 2) ** 0.5] for s, r in pairs]


def assert_graph_is(graph, rest, x, velocity, known, kind, radius):
    """A graph of `tiny` is what the definition says. Features are float32 of numbers up to 4: half a unit in the last place is 2e-7."""
    pairs = edges_by_hand()
    node = [node_by_hand(rest, x, velocity, known, kind, i) for i in range(len(x))]
    mesh_edge = [mesh_edge_by_hand(rest, x, s, r) for s, r in pairs]
    contact_pairs, contact_edge = contacts_by_hand(x, kind, radius)
    assert graph.mesh_pair.T.tolist() == [list(pair) for pair in pairs]
    assert graph.contact_pair.T.tolist() == [list(pair) for pair in contact_pairs]
    for found, expected, width in ((graph.node, node, 12), (graph.mesh_edge, mesh_edge, 8), (graph.contact_edge, contact_edge, 4)):
        assert found.dtype.is_floating_point and found.element_size() == 4 and found.shape == (len(expected), width)
        assert np.allclose(found.numpy(), np.reshape(expected, (-1, width)), rtol=0, atol=3e-7)

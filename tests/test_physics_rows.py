"""Rows of a stiffness that several processes share, put together from what each of two has: the dense matrix, and its fields."""

from types import SimpleNamespace

import numpy as np
import pytest

from physics.equilibrium.balance import Balance
from physics.linalg.rows import MatrixRows
from physics.mesh.build import build_mesh
from tests import dense
from tests.scenes import beam

SUPPORT = [{"where": "x-max", "fixed": "xyz"}, {"where": "x-min", "fixed": "y"}]  # the first nodes are free but for y


@pytest.fixture(scope="module", params=[1, 2, 4])
def shared(request):
    """A body along y whose nodes are not numbered that way, its displacements, and its rows as each of some processes has them."""
    scene = beam(body={"length": 0.03, "width": 0.06, "height": 0.02, "cells": [2, 4, 1], "cell": "hexahedron"}, support=SUPPORT)
    body = Balance(scene, build_mesh(scene.body)).elasticity
    u = np.where(body.fixed, 0, np.random.default_rng(0).uniform(-2e-4, 2e-4, body.fixed.shape))
    parts = [MatrixRows(body, SimpleNamespace(size=request.param, rank=rank)) for rank in range(request.param)]
    return body, u, parts


def whole(parts, values):
    """(n, n) in the order of the rows."""
    n = parts[0].unknown.size
    matrix = np.zeros((n, n))
    for part, own in zip(parts, values, strict=True):
        for i in range(3 * (part.last - part.first)):
            columns = part.indices[part.indptr[i]:part.indptr[i + 1]]
            assert len(set(columns)) == len(columns)
            matrix[3 * part.first + i, columns] = own[part.indptr[i]:part.indptr[i + 1]]
    return matrix


def test_the_rows_of_all_processes_are_the_stiffness(shared):
    body, u, parts = shared
    order = parts[0].unknown.ravel()
    found = whole(parts, [part.stiffness(u) for part in parts])[np.ix_(order, order)]
    free = ~body.fixed.ravel()
    expected = dense.stiffness(body, u) * np.outer(free, free)
    np.testing.assert_allclose(found, expected, atol=1e-12 * abs(expected).max())
    # Where the diagonal entries of held components are: those that stand alone with a 1.
    marks = [np.zeros(len(part.indices) + 1) for part in parts]
    for part, mark in zip(parts, marks, strict=True):
        mark[part.held] = 1
    assert np.array_equal(whole(parts, marks)[np.ix_(order, order)], np.diag(body.fixed.ravel().astype(float)))


def test_processes_have_layers_across_the_longest_extent_in_turn(shared):
    body, _, parts = shared
    count = len(body.mesh.points)
    assert [part.first for part in parts] == [count * i // len(parts) for i in range(len(parts))]
    assert [part.last for part in parts] == [count * (i + 1) // len(parts) for i in range(len(parts))]
    y = np.empty(count)
    y[parts[0].unknown[:, 0] // 3] = body.mesh.points[:, 1]
    assert (np.diff(y) >= 0).all() and parts[0].share.sum() == 3 * count


def test_a_field_comes_back_from_its_parts_without_what_is_held(shared):
    body, _, parts = shared
    field = np.random.default_rng(1).normal(size=body.fixed.shape)
    mine = [part.mine(field) for part in parts]
    assert [len(each) for each in mine] == parts[0].share.tolist()

    def gather(own, into):
        into[0][:] = np.concatenate(mine)

    parts[0].comm.Allgatherv = gather
    assert np.array_equal(parts[0].whole(mine[0]), np.where(body.fixed, 0, field))


def test_what_couples_some_nodes_is_added_to_each_process_and_read_back(shared):
    """Of nodes of one cell, in no order; held components get nothing."""
    body, u, parts = shared
    nodes = body.cells[3][[5, 0, 6, 3]].astype(np.int64)
    block = np.random.default_rng(2).normal(size=(12, 12))
    values = [part.stiffness(u) for part in parts]
    before = [each.copy() for each in values]
    for part, own in zip(parts, values, strict=True):
        part.add(nodes, block, own)
    order = parts[0].unknown.ravel()
    change = (whole(parts, values) - whole(parts, before))[np.ix_(order, order)]
    asked = (3 * nodes[:, None] + np.arange(3)).ravel()
    free = ~body.fixed.ravel()[asked]
    wanted = np.zeros_like(change)
    wanted[np.ix_(asked, asked)] = block * np.outer(free, free)
    np.testing.assert_allclose(change, wanted, atol=1e-9)
    total = np.zeros((len(nodes), 3, len(nodes), 3))
    for part, own in zip(parts, values, strict=True):
        part.comm.Allreduce = lambda _, found: np.add(total, found, out=total)
        part.dense(nodes, own)
    expected = (dense.stiffness(body, u))[np.ix_(asked, asked)] * np.outer(free, free) + block * np.outer(free, free)
    np.testing.assert_allclose(total.reshape(12, 12), expected, atol=1e-9 * abs(expected).max())

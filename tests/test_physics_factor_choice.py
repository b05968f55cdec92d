"""Which factor a body gets, and each factor against the dense matrix."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from physics.equilibrium.balance import Balance
from physics.linalg import cholesky
from physics.linalg.cholesky import BandFactor, DissectionFactor, NotPositiveDefinite, narrowest_order
from physics.linalg.factor import factor_for, solver_for
from physics.linalg.indefinite import SparseFactor
from physics.linalg.multigrid import Multigrid
from physics.linalg.ordering.nested import dissect
from physics.mesh.build import build_mesh
from tests import dense
from tests.scenes import beam

# Held in one component of one end and in all of the other: masks with both values in one node.
SUPPORT = [{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "y"}]


def elasticity(cells=(4, 2, 2), size=(0.06, 0.02, 0.02), cell="hexahedron"):
    scene = beam(body={"length": size[0], "width": size[1], "height": size[2], "cells": list(cells), "cell": cell}, support=SUPPORT)
    return Balance(scene, build_mesh(scene.body)).elasticity


def made(kind, body):
    return BandFactor(body, *narrowest_order(body)) if kind is BandFactor else kind(body)


@pytest.mark.parametrize("kind", [BandFactor, DissectionFactor, SparseFactor])
def test_a_factor_solves_what_numpy_does(kind):
    body = elasticity()
    rng = np.random.default_rng(0)
    u = np.where(body.fixed, 0, rng.uniform(-2e-4, 2e-4, body.fixed.shape))
    found = made(kind, body)
    for at in (u, 0 * u):  # a second time, another stiffness
        found.update(at)
        K = dense.stiffness(body, at)
        force, nodes = rng.normal(size=u.shape), np.array([40, 7, 44, 0, 22])  # the last of an end, a held one, in no order
        expected = dense.solved(body, at, force)
        assert found.solve(force) == pytest.approx(expected, abs=1e-9 * abs(expected).max())
        unknown = (3 * nodes[:, None] + np.arange(3)).ravel()
        free = ~body.fixed.ravel()[unknown]
        compliance = np.linalg.inv(K)[np.ix_(unknown, unknown)] * np.outer(free, free)
        assert found.compliance(nodes) == pytest.approx(compliance, abs=1e-9 * abs(compliance).max())
        assert found.compliance(nodes[:2]) == pytest.approx(compliance[:6, :6], abs=1e-9 * abs(compliance).max())
        push = np.zeros_like(force)
        push[nodes] = rng.normal(size=(5, 3))
        begun = found.begin(force)
        kept = begun.copy()
        both = dense.solved(body, at, force + push)
        assert found.finish(begun, nodes, push[nodes]) == pytest.approx(both, abs=1e-9 * abs(both).max())
        assert found.at(begun, nodes) == pytest.approx(expected[nodes], abs=1e-9 * abs(expected).max())
        for more in ((), (nodes, 0 * push[nodes]), (nodes, None), (None, push[nodes])):
            assert found.finish(begun, *more) == pytest.approx(expected, abs=1e-9 * abs(expected).max())
        assert np.array_equal(np.asarray(begun), kept) or kind is not SparseFactor
        assert np.sort(np.concatenate(found.learned)).tolist() == np.sort(nodes).tolist() and found.negative == 0
    found.update(u)
    assert len(found.learned) == 0  # of another stiffness
    found.learn(np.array([3, 9]))
    assert [group.tolist() for group in found.learned] == [[3, 9]]


def test_the_general_factor_counts_what_is_negative():
    body = elasticity()
    found = SparseFactor(body)
    squeezed = -0.55 * body.mesh.points * [0, 0, 1]
    found.update(squeezed)
    assert found.negative == (np.linalg.eigvalsh(dense.stiffness(body, squeezed)) < 0).sum() > 0
    expected = dense.solved(body, squeezed, np.ones(body.fixed.shape))
    assert found.solve(np.ones(body.fixed.shape)) == pytest.approx(expected, abs=1e-7 * abs(expected).max())
    found.update(0 * squeezed)
    assert found.negative == 0 and found.worth == 8
    found.learn(np.array([9, 3]))
    found.learn(np.array([5]))
    assert [group.tolist() for group in found.learned] == [[3, 5, 9]]


@pytest.mark.parametrize("kind", [BandFactor, DissectionFactor])
def test_a_stiffness_that_is_not_a_number_has_no_factor(kind):
    body = elasticity()
    with pytest.raises(NotPositiveDefinite):
        made(kind, body).update(np.full(body.fixed.shape, np.nan))
    with pytest.raises(NotPositiveDefinite):
        made(kind, body).update(np.where(body.fixed, 0.0, -0.6 * body.mesh.points * [0, 0, 1]))


def test_the_narrowest_band_is_that_across_the_longest_extent():
    """9 nodes a layer: within a cell of a numbering along the bar, places differ by up to 9 + 3 + 1 = 13: 3 * 13 + 2 = 41 unknowns."""
    for size in itertools.permutations((0.06, 0.02, 0.021)):
        cells = [4 if length == 0.06 else 2 for length in size]
        place, band = narrowest_order(elasticity(cells, size))
        assert sorted(place) == list(range(45)) and band <= 41
        body = elasticity(cells, size)
        assert band == max(3 * (int(place[cell].max()) - int(place[cell].min())) + 2 for cell in body.cells)
        along = (body.mesh.points / size)[:, np.argmax(size)]
        order = along[np.argsort(place)]
        assert (np.diff(order) >= -0.26).all()  # Cuthill-McKee's may be a little narrower, and mixes neighbouring layers


def test_what_is_tried_are_three_numberings(monkeypatch):
    """The mesh's own when it is the narrowest, and Cuthill and McKee's where no axis is any good: a ring, here of shuffled nodes."""
    count = 12
    ring = np.stack([np.arange(count), (np.arange(count) + 1) % count], axis=1)
    turn = 2 * np.pi * np.arange(count) / count
    points = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    shuffled = np.random.default_rng(0).permutation(count)

    def body(points, cells):
        return SimpleNamespace(mesh=SimpleNamespace(points=points, edges=cells, dimension=3, cell="prism"), cells=cells)

    # A ring can be numbered with neighbours two apart, to and fro: 3 * 2 + 2.
    where = np.random.default_rng(1).normal(size=(count, 3))
    assert narrowest_order(body(where, shuffled[ring]))[1] == 8
    line = ring[:-1]
    place, band = narrowest_order(body(where, line))  # the mesh's own numbering: one apart
    assert band == 5 and place.tolist() == list(range(count))
    at = np.empty((count, 3))
    at[shuffled] = np.stack([turn * 0, turn * 0, turn], axis=1)
    place, band = narrowest_order(body(at, shuffled[line]))
    assert band == 5 and place[shuffled].tolist() in (list(range(count)), list(range(count))[::-1])
    assert narrowest_order(body(points, ring))[1] == 8


def test_a_body_gets_a_band_a_dissection_or_multigrid_by_size(monkeypatch):
    body = elasticity()
    band = narrowest_order(body)[1]
    assert cholesky.WIDEST_BAND == 200 and cholesky.MOST_NUMBERS == 500_000_000
    assert isinstance(solver_for(body), BandFactor) and f"a half-bandwidth of {band}, at most 200" in solver_for(body).name
    monkeypatch.setattr(cholesky, "WIDEST_BAND", band)
    assert isinstance(solver_for(body), BandFactor)
    monkeypatch.setattr(cholesky, "WIDEST_BAND", band - 1)
    found = solver_for(body)
    numbers = dissect(body.mesh.points, body.cells).numbers
    assert isinstance(found, DissectionFactor) and f"{4e-9 * numbers:.2g} GB in single precision, at most 4 GB" in found.name
    monkeypatch.setattr(cholesky, "MOST_NUMBERS", numbers)
    assert isinstance(solver_for(body), DissectionFactor)
    monkeypatch.setattr(cholesky, "MOST_NUMBERS", numbers - 1)
    found = solver_for(body)
    assert isinstance(found, Multigrid) and f"for a factor would take {8 * numbers / 1e9:.2g} GB, more than" in found.name
    assert isinstance(solver_for(body, method="direct"), DissectionFactor) and isinstance(factor_for(body), DissectionFactor)
    assert solver_for(body, method="multigrid").name.endswith("multigrid, as asked for")
    assert solver_for(body, spread=True).name.endswith("multigrid, which processes share")
    assert solver_for(body, method="direct", spread=True).name.endswith("which processes share")


def test_a_factor_is_worth_as_many_steps_as_its_operations_over_thirty_for_each_number():
    """At least 8. A band b takes b operations for each of its numbers; a dissection as many as its own count says."""
    body = elasticity()
    place, band = narrowest_order(body)
    assert BandFactor(body, place, band).worth == 8
    for wider, worth in ((290, 10), (300, 10), (320, 11)):
        assert BandFactor(body, place, wider).worth == worth
    found = dissect(body.mesh.points, body.cells)
    assert DissectionFactor(body, replace(found, operations=25 * 30.0 * found.numbers)).worth == 25
    assert DissectionFactor(body).worth == 8


def test_a_wider_band_than_needed_solves_the_same():
    body = elasticity()
    place, band = narrowest_order(body)
    one, two = BandFactor(body, place, band), BandFactor(body, place, band + 7)
    for each in (one, two):
        each.update(np.zeros(body.fixed.shape))
    assert two.solve(np.ones(body.fixed.shape)) == pytest.approx(one.solve(np.ones(body.fixed.shape)), rel=1e-9, abs=1e-15)

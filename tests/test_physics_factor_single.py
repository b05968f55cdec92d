"""Factors in single precision: as far off as that is, never where the body is too soft for it, and the same answers of a scene."""

import numpy as np
import pytest

from physics import journal
from physics.body.elasticity import Elasticity
from physics.equilibrium.balance import Balance
from physics.equilibrium.path import LoadPath
from physics.equilibrium.tangent import KeptFactor
from physics.linalg import cholesky
from physics.linalg.cholesky import DissectionFactor, NotPositiveDefinite
from physics.linalg.factor import factor_for, solver_for
from physics.mesh.build import build_mesh
from physics.solution import solve
from tests.scenes import beam, pressed


def body(length=0.06, cells=(12, 4, 4), poisson_ratio=0.4) -> Elasticity:
    shape = {"length": length, "width": 0.02, "height": 0.02, "cells": list(cells), "cell": "hexahedron"}
    scene = beam(body=shape, material={"young_modulus": 1e6, "poisson_ratio": poisson_ratio})
    return Balance(scene, build_mesh(scene.body)).elasticity


def both(elasticity):
    """The factor of double precision and that of single precision, at rest."""
    found = DissectionFactor(elasticity), DissectionFactor(elasticity, single=True)
    for factor in found:
        factor.update(np.zeros(elasticity.fixed.shape))
    return found


def test_a_single_factor_solves_to_single_precision_in_half_the_memory():
    """A block's softest motion is a thousandth as stiff as its stiffest: solutions are off by about 1000 * 6e-8, not by 1e-12."""
    wide, narrow = both(body())
    assert wide.double and not narrow.double
    assert narrow._panels.values.nbytes * 2 == wide._panels.values.nbytes and "in single precision" in narrow.name
    dice, nodes = np.random.default_rng(0), np.array([5, 80, 200])
    force, push = dice.normal(size=wide.elasticity.fixed.shape), dice.normal(size=(3, 3))
    found = []
    for factor in (wide, narrow):
        begun = factor.begin(force)
        found.append((factor.solve(force), factor.compliance(nodes), factor.finish(begun, nodes, push), factor.at(begun, nodes)))
    for exact, near in zip(*found, strict=True):
        assert near.dtype == np.float64
        assert 1e-9 < abs(near - exact).max() / abs(exact).max() < 2e-4


def test_the_stiffness_of_the_softest_motion_is_found():
    """By eigenvalues of the whole matrix."""
    elasticity = body(cells=(6, 2, 2))
    factor, free = both(elasticity)[1], ~elasticity.fixed.ravel()
    inverse = np.stack([factor.solve(unit.reshape(-1, 3)).ravel() for unit in np.eye(free.size)[free]])[:, free]
    softest = 1 / np.linalg.eigvalsh((inverse + inverse.T) / 2)[-1]
    assert factor._softest() == pytest.approx(softest, rel=0.05)


@pytest.mark.parametrize("length, cells, poisson_ratio, double", [
    (0.06, (12, 4, 4), 0.4, False), (0.6, (120, 4, 4), 0.4, True), (6.0, (240, 2, 2), 0.4, True), (0.06, (12, 4, 4), 0.499999, True)])
def test_bodies_too_soft_for_single_precision_get_double(length, cells, poisson_ratio, double):
    """The softest motion of a cantilever of 30 widths is softer than the stiffest one's rounding; so it is nearly incompressible."""
    elasticity = body(length, cells, poisson_ratio)
    wide, narrow = both(elasticity)
    assert narrow.double is double and ("single" in narrow.name) is not double
    force = np.ones(elasticity.fixed.shape)
    assert narrow.solve(force) == pytest.approx(wide.solve(force), abs=(1e-12 if double else 1e-3) * abs(wide.solve(force)).max())
    narrow.update(np.zeros_like(force))
    assert narrow.double is double  # and stays so


def test_what_has_no_factor_is_tried_in_double_before_that_is_said():
    elasticity = body()
    factor = DissectionFactor(elasticity, single=True)
    with pytest.raises(NotPositiveDefinite):
        factor.update(-0.6 * elasticity.mesh.points * [0, 0, 1])
    assert factor.double
    with pytest.raises(NotPositiveDefinite):
        DissectionFactor(elasticity, single=True).update(np.full(elasticity.fixed.shape, np.nan))


def test_newtons_method_gets_a_single_factor_and_who_solves_once_does_not(monkeypatch):
    monkeypatch.setattr(cholesky, "WIDEST_BAND", 10)
    elasticity = body()
    assert not solver_for(elasticity).double and factor_for(elasticity).double


def test_a_factor_that_has_become_double_is_double_when_a_path_goes_on():
    elasticity = body()
    rest = np.zeros(elasticity.fixed.shape)
    kept = KeptFactor(DissectionFactor(elasticity, single=True))
    kept.renew(rest)
    assert not kept.memory().double
    kept.solver.widen()
    kept.renew(rest)
    again = KeptFactor(DissectionFactor(elasticity, single=True))
    again.recall(kept.memory())
    assert again.solver.double and np.array_equal(again.solve(rest + 1), kept.solve(rest + 1))
    kept.stale = True
    other = KeptFactor(DissectionFactor(elasticity, single=True))
    other.recall(kept.memory())
    assert other.solver.double


@pytest.fixture
def dissected(monkeypatch):
    monkeypatch.setattr(cholesky, "WIDEST_BAND", 10)


def test_a_scene_ends_where_it_does_in_double_precision(dissected, monkeypatch):
    scene, ends, steps = pressed(steps={"count": 12}), [], []
    for softest in (cholesky.SOFTEST, np.inf):
        monkeypatch.setattr(cholesky, "SOFTEST", softest)
        path = LoadPath(scene, build_mesh(scene.body))
        steps.append(sum(path.advance(step / 12).iterations for step in range(1, 13)))
        assert path.newton.tangent.solver.double is (softest == np.inf)
        ends.append(path.states[-1].u)
    assert abs(ends[0] - ends[1]).max() < 1e-5 * abs(ends[1]).max() and steps[0] <= 1.1 * steps[1]


def test_no_rounding_keeps_a_scene_from_balance(dissected):
    """Contact forces cancel what presses in the equations, not after these are solved: so steps become as small as the residual asks."""
    scene = pressed(steps={"count": 4})
    path = LoadPath(scene, build_mesh(scene.body), tolerance=1e-10)
    for step in range(1, 5):
        state = path.advance(step / 4)
        assert state.residual < 1e-10 and state.pressure.any() == (step > 0)
    assert not path.newton.tangent.solver.double and not path.halvings


def test_a_path_that_is_cut_off_goes_on_to_the_same_bits(dissected, tmp_path, monkeypatch):
    class Cut(Exception):
        pass

    def cut(step):
        if step == 5:
            raise Cut

    monkeypatch.setattr(journal, "EVERY", 0.0)
    scene = pressed(steps={"count": 8})
    whole = solve(scene)
    with pytest.raises(Cut):
        solve(scene, journal=tmp_path / "part", on_step=cut)
    again = solve(scene, journal=tmp_path / "part")
    assert again.resumed == 5 and again.displacement.tobytes() == whole.displacement.tobytes()

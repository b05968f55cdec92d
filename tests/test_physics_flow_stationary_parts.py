"""Newton's method for a stationary flow, part by part: its matrix, when it goes on, and how the viscosity is brought down."""

import numpy as np
import pytest

from physics.flow import stationary as module
from physics.flow.conditions import Conditions
from physics.flow.space import FlowSpace
from physics.flow.stationary import Equations, NoStationaryFlow, Stationary, _at, _convection, stationary
from tests.flows import rectangle
from tests.test_physics_flow_space import grad_u, integral, u, v

NU = 0.3


def equations(order, enclosed):
    space = FlowSpace(rectangle(2, seed=3), order)
    outer, x = space.mesh.boundary[0], space.velocity.points
    right = (space.mesh.points[outer, 0] > 1 - 1e-9).all(axis=1)
    fixed = space.velocity.on_edges(space.mesh, outer if enclosed else outer[~right])
    return Equations(space, Conditions(fixed, lambda t: 1 + x[fixed], outer[:0] if enclosed else outer[right], lambda t: np.cos(x + t)))


@pytest.mark.parametrize("order", (2, 3))
@pytest.mark.parametrize("enclosed", (True, False))
def test_a_step_of_newtons_is_that_of_the_residuals_derivative(order, enclosed):
    """The residual is quadratic, so differences to both sides are its derivative. Fluid comes in on the left and leaves on the right."""
    of = equations(order, enclosed)
    random = np.random.default_rng(1)
    x = random.normal(size=2 * of.nodes + of.pressures)
    x[:2 * of.nodes:2] = np.abs(x[:2 * of.nodes:2]) + 2
    residual, free = of.residual(x, NU), np.flatnonzero(of.free)
    assert len(free) == 2 * (of.nodes - len(of.conditions.fixed)) + of.pressures - enclosed and not np.delete(residual, free).any()
    columns = []
    for k in free:
        h = np.zeros_like(x)
        h[k] = 1.0
        columns.append((of.residual(x + h, NU) - of.residual(x - h, NU))[free] / 2)
    step = of.step(x, residual, NU, True)
    np.testing.assert_allclose(np.stack(columns, axis=1) @ step[free], -residual[free], atol=1e-9 * abs(residual).max())
    assert not np.delete(step, free).any() and abs(of.step(x, residual, NU, False) - step).max() > 1e-3
    still = of.residual(x, NU, still=True)
    space, w, p = of.space, x[:2 * of.nodes].reshape(-1, 2), x[2 * of.nodes:]
    wanted = NU * (space.matrix(space.viscosity) @ w) - space.momentum(0 * w, np.cos(space.velocity.points), p)
    np.testing.assert_allclose(still, np.where(of.free, np.append(wanted, -space.divergence(w)), 0), atol=1e-12)
    np.testing.assert_allclose((residual - still)[:2 * of.nodes],
                               np.where(of.free[:2 * of.nodes], -space.momentum(w, 0 * w, 0 * p).ravel(), 0), atol=1e-12)


@pytest.mark.parametrize("order", (2, 3))
def test_what_fluid_carries_is_its_flux_and_half_of_what_it_spreads(order):
    """(u . grad v + (div u) v / 2, u) of polynomials by quadrature; the derivative by u besides, (v . grad u + (div v) u / 2, u)."""
    space = FlowSpace(rectangle(2, seed=3), order)
    x, cells = space.velocity.points, space.velocity.cells

    def form(newton):
        both = [field(x)[cells].reshape(len(cells), -1) for field in (u, v)]
        return np.einsum("ci,cij,cj->", both[0], _convection(space, u(x)[cells], newton), both[1])

    def grad_v(z):
        return np.stack([np.stack([0 * z[:, 0], 2 * z[:, 1]], axis=1), np.stack([2 - z[:, 1], -z[:, 0]], axis=1)], axis=1)

    def carried(wind, grad_wind, field, gradient):
        spread = np.einsum("ndd->n", grad_wind)[:, None] / 2
        return np.einsum("nd,nkd->nk", wind, gradient) + spread * field

    picard = integral(lambda z: (carried(u(z), grad_u(z), v(z), grad_v(z)) * u(z)).sum(axis=1))
    assert form(False) == pytest.approx(picard, rel=1e-11)
    more = integral(lambda z: (carried(v(z), grad_v(z), u(z), grad_u(z)) * u(z)).sum(axis=1))
    assert form(True) == pytest.approx(picard + more, rel=1e-11)


def test_a_closed_flow_has_a_pressure_of_mean_zero_and_the_velocities_that_are_given():
    space = FlowSpace(rectangle(3, seed=3), 2)
    fixed = space.velocity.on_edges(space.mesh, space.mesh.boundary[0])
    given = np.where(space.velocity.points[fixed, 1:] > 1 - 1e-9, [[1.0, 0.0]], 0.0)
    found = stationary(space, Conditions(fixed, lambda t: given, np.empty((0, 2), np.int64)), NU)
    np.testing.assert_array_equal(found.u[fixed], given)
    weights = np.bincount(space.pressure.cells.ravel(), space.mass_of_pressure().sum(axis=2).ravel())
    assert abs(weights @ found.p) < 1e-12 < abs(found.p).max() and found.residual <= 1e-11
    assert 2 < found.iterations < 12


class Steps:
    """Equations whose residual has the next of some sizes at each look; which steps were Newton's."""

    def __init__(self, *sizes):
        self.sizes, self.newton = list(sizes), []

    def residual(self, x, viscosity):
        assert viscosity == NU
        return np.array([3.0, 4.0]) / 5 * (self.sizes.pop(0) if len(self.sizes) > 1 else self.sizes[0])

    def step(self, x, residual, viscosity, newton):
        self.newton.append(bool(newton))
        return np.ones(1)


def at(*sizes, scale=2.0):
    of = Steps(*(scale * size for size in sizes))
    x, used, size = _at(of, np.zeros(1), NU, scale)
    assert used == len(of.newton) and (x is None or x[0] == used)
    return x is not None, used, of.newton, size


def test_four_steps_are_picards_unless_it_is_near_and_the_others_newtons():
    assert at(0.99e-11) == (True, 0, [], pytest.approx(0.99e-11))
    assert at(1.0, 0.5, 0.25, 0.2, 0.1, 0.01, 1e-12)[:3] == (True, 6, [False] * 4 + [True] * 2)
    assert at(1.0, 1.01e-3, 0.99e-3, 1e-6, 1e-12)[:3] == (True, 4, [False, False, True, True])
    assert at(1.0, *[0.5] * 30)[:2] == (False, 24) == (False, module.PICARD + module.NEWTON)


def test_what_grows_past_a_million_or_is_no_number_is_given_up():
    assert at(1.0, 0.99e6, 1e-12)[:2] == (True, 2) and at(1.0, 1.01e6, 1e-12)[:2] == (False, 1)
    assert at(1.0, np.nan)[:2] == (False, 1)


def test_what_shrinks_no_further_near_the_tolerance_is_taken():
    """By less than a tenth in a step of Newton's, below a hundred times the tolerance; in one of Picard's it goes on."""
    start = (1.0, 1e-2, 1e-2, 1e-2, 1e-2)  # four steps of Picard's
    assert at(*start, 1e-8, 0.99e-9, 0.99e-9 * 0.91, 1e-12)[:2] == (True, 7)
    assert at(*start, 1e-8, 0.99e-9, 0.99e-9 * 0.89, 1e-12)[:2] == (True, 8)
    assert at(*start, 1e-8, 1.02e-9, 1.02e-9 * 0.99, 1e-12)[:2] == (True, 8)
    assert at(1.0, 0.99e-9, 0.98e-9, 0.97e-9, 0.96e-9, 1e-12)[:2] == (True, 5)
    assert at(1.0, 0.99e-9, 0.98e-9, 0.97e-9, 0.96e-9, 0.95e-9, 0.94e-9, 1e-12)[:2] == (True, 6)


@pytest.fixture
def tried(monkeypatch):
    """Outcomes of each viscosity in turn, True where a flow is found; the viscosities and what each began at."""
    def run(*outcomes):
        seen, left = [], list(outcomes)

        def one(equations, x, viscosity, scale):
            seen.append((viscosity / NU, float(x[-1])))
            fine = left.pop(0) if left else False
            return (np.full_like(x, float(len(seen))) if fine else None), 10, 0.125

        monkeypatch.setattr(module, "_at", one)
        space = FlowSpace(rectangle(2), 2)
        outer = space.mesh.boundary[0]
        fixed = space.velocity.on_edges(space.mesh, outer[:-1])
        try:
            found = stationary(space, Conditions(fixed, lambda t: np.ones((len(fixed), 2)), outer[-1:]), NU)
        except NoStationaryFlow as error:
            found = error
        return found, seen
    return run


def test_the_viscosity_is_taken_four_times_as_large_and_halved_each_flow_from_the_last(tried):
    found, seen = tried(False, False, True, False, *[True] * 6)
    np.testing.assert_allclose([at for at, _ in seen], [1, 4, 16, 8, 32, 16, 8, 4, 2, 1])
    starts = [start for _, start in seen]
    assert starts[0] == starts[1] == starts[2] and starts[3:] == [3, 3, 5, 6, 7, 8, 9] and (found.u == 10).all()


def test_a_flow_at_the_viscosity_itself_is_the_answer_and_all_solves_count(tried):
    found, seen = tried(True)
    assert isinstance(found, Stationary) and (found.iterations, found.residual) == (11, 0.125)
    assert (found.u == 1).all() and (found.p == 1).all()
    found, seen = tried(False, True, True, True)
    np.testing.assert_allclose([at for at, _ in seen], [1, 4, 2, 1])
    assert found.iterations == 41 and (found.u == 4).all()


def test_after_thirteen_trials_there_is_none(tried):
    found, seen = tried()
    assert len(seen) == 13 == 2 * module.MOST + 1
    assert str(found).startswith("no stationary flow: the residual is 0.12 of that at the start after 131 linear solves, at 1.68e+07 times")


def test_a_flow_that_is_at_rest_is_found_at_once():
    space = FlowSpace(rectangle(2), 2)
    fixed = space.velocity.on_edges(space.mesh, space.mesh.boundary[0])
    found = stationary(space, Conditions(fixed, lambda t: np.zeros((len(fixed), 2)), np.empty((0, 2), np.int64)), NU)
    assert not found.u.any() and not found.p.any() and (found.iterations, found.residual) == (1, 0.0)

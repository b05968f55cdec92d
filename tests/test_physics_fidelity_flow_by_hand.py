"""The figures of a predicted flow against plain sums over frames, its equations standing in; windows and limits at their edges."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from physics.fidelity.flow import FlowReference, _rms, frequency, nothing_changes

S, SPAN, FIRST, FRAMES = 5, 0.25, 1, 41
INSIDE = np.array([True, True, False, True, False])
GIVEN = np.array([2, 4])


class Equations:
    """Numbers that depend on everything they are given, and on nothing else."""

    density, area, given = 2.0, 9.0, GIVEN

    def values(self, time):
        return np.array([[time, 1.0], [0.0, -time]])

    def inflow(self, time):
        return 3.0 - time

    def divergence(self, u):
        return u[0, 0]

    def energy(self, u):
        return (u**2).sum()

    def forces(self, u, p, rate):
        return u, p, rate

    def residual(self, forces):
        u, p, rate = forces
        return u[1, 1] + 2 * p[3] + 3 * rate[0, 1]

    def on_place(self, forces):
        return np.array([forces[1][1] + forces[2][0, 0], forces[1][0]])  # drag from p 1 and a rate, lift p 0

    def fluxes(self, u):
        return u[:, :2, 0]


def scene_of(**force):
    given = SimpleNamespace(**{"length": 0.5, "speed": 4.0} | force)
    return SimpleNamespace(fluid=SimpleNamespace(density=2.0), force=given, body=SimpleNamespace(shape="plate"))


def flows(frames=FRAMES, seed=0):
    """Velocity and pressure at random, the lift a wave of 0.13 periods a frame."""
    random = np.random.default_rng(seed)
    u, p = random.normal(size=(frames, S, 2)), random.normal(size=(frames, S))
    p[:, 0] = (2 + seed) * np.sin(2 * np.pi * (0.13 + 0.02 * seed) * np.arange(frames) + 0.3)
    return u, p


def reference(frames=FRAMES, scene=None, **changes):
    u, p = flows(frames)
    made = FlowReference(**{"velocity": u, "pressure": p, "predicted": INSIDE, "mesh": SimpleNamespace(points=np.zeros((S, 3))),
                            "scene": scene or scene_of(), "span": SPAN, "first": FIRST} | changes)
    vars(made)["_currents"] = Equations()
    return made


def rms(values):
    return math.sqrt(np.mean(np.square(values)))


def test_every_figure_of_the_equations_is_the_sum_that_it_says():
    made, (u, p) = reference(), flows(seed=1)
    found, of, frames = made.verify(u, p), Equations(), list(range(4, 40))  # from a tenth of 40 on, each with one after

    def forces(v, q, t):
        return of.forces(v[t], q[t], (v[t + 1] - v[t - 1]) / (2 * SPAN))

    true, true_p = made.velocity, made.pressure
    fastest = max(np.hypot(*v) for v in true[2:].reshape(-1, 2))
    assert found.divergence == pytest.approx(rms([u[t, 0, 0] for t in frames]))
    assert found.momentum_residual == pytest.approx(rms([of.residual(forces(u, p, t)) for t in frames]) / (2.0 * fastest**2 * 3.0))
    assert found.slip == pytest.approx(max(np.hypot(*(u[t, GIVEN] - of.values(SPAN * t)).T).max() for t in range(2, FRAMES)))
    inflow = [3.0 - SPAN * t for t in range(FRAMES)]
    assert found.flux_error == pytest.approx(max(abs(u[t, :2, 0] - inflow[t]).max() for t in frames) / max(map(abs, inflow)))
    own, due = (np.array([of.on_place(forces(v, q, t)) for t in frames]) for v, q in ((u, p), (true, true_p)))
    assert found.drag_error == pytest.approx(rms(own[:, 0] - due[:, 0]) / abs(due[:, 0]).max())
    assert found.lift_error == pytest.approx(rms(own[:, 1] - due[:, 1]) / abs(due[:, 1]).max())
    energies = [(of.energy(u[t]), of.energy(true[t])) for t in frames]
    assert found.kinetic_energy_error == pytest.approx(rms([a - b for a, b in energies]) / max(b for _, b in energies))
    own, due = (frequency(q[20:40, 0]) / SPAN * 0.5 / 4.0 for q in (p, true_p))
    assert found.strouhal == pytest.approx(own) and found.strouhal_error == pytest.approx(abs(own - due) / due)
    assert 0.01 < abs(own - due) and math.isnan(found.spectrum_error)
    again = made.verify(true, true_p)
    assert again.drag_error == again.lift_error == again.kinetic_energy_error == again.strouhal_error == 0 < again.divergence


def test_a_lift_that_is_nothing_beside_the_drag_is_held_against_a_hundredth_of_it():
    u, p = flows()
    p[:, 0] = 1e-9 * np.arange(FRAMES)
    made = reference(pressure=p)
    other = p.copy()
    other[:, 0] += 0.5
    drag = max(abs(Equations().on_place((u[t], p[t], (u[t + 1] - u[t - 1]) / (2 * SPAN)))[0]) for t in range(4, 40))
    assert made.verify(u, other).lift_error == pytest.approx(50.0 / drag, rel=1e-6)


def test_without_motion_or_inflow_what_is_relative_is_no_number():
    u = np.zeros((FRAMES, S, 2))
    made = reference(velocity=u, pressure=np.zeros((FRAMES, S)))
    vars(made)["_currents"].inflow = lambda time: 0.0
    found = made.verify(u, np.zeros((FRAMES, S)))
    for name in ("momentum_residual", "flux_error", "drag_error", "lift_error", "kinetic_energy_error", "strouhal", "strouhal_error"):
        assert math.isnan(getattr(found, name)), name
    assert found.divergence == 0


def test_a_prediction_that_is_the_truth_but_for_its_pressure_is_looked_at_for_itself():
    made = reference()
    _, p = flows(seed=1)
    assert made.verify(made.velocity, p).lift_error > 0.1 and made.verify(flows(seed=1)[0], made.pressure).kinetic_energy_error > 0.01
    assert math.isnan(reference(pressure=None).verify(made.velocity, p).drag_error)


@pytest.mark.parametrize("frames, first, sample, wanted", [
    (101, 1, None, list(range(10, 100))), (101, 1, 4, [10, 40, 69, 99]), (101, 1, 1, [10]), (101, 1, 200, list(range(10, 100))),
    (8, 3, None, [4, 5, 6]), (8, 0, None, [1, 2, 3, 4, 5, 6]), (16, 0, None, list(range(2, 15))), (4, 1, None, [2]), (3, 1, None, [])])
def test_the_frames_that_are_checked_have_one_before_and_one_after(frames, first, sample, wanted):
    assert reference(frames, first=first, sample=sample)._checked.tolist() == wanted


def test_too_few_frames_or_no_scene_have_no_equations():
    short = reference(3)
    found = short.verify(*flows(3, seed=1))
    assert math.isnan(found.divergence) and math.isnan(found.slip) and found.velocity_rmse_all > 0
    assert math.isnan(FlowReference(*flows(), INSIDE, None).verify(flows(seed=1)[0]).flux_error)
    one = reference(4).verify(*flows(4, seed=1))
    assert one.divergence == pytest.approx(abs(flows(4, seed=1)[0][2, 0, 0]))


def test_errors_are_those_of_the_predicted_nodes_in_their_windows():
    """First shown frame 1: the first step is frame 2, fifty steps end with frame 51."""
    made, (u, p) = reference(60), flows(60, seed=1)
    found = made.verify(u, p)
    error, pressure = (u - made.velocity)[:, INSIDE], p - made.pressure
    assert found.velocity_rmse_1 == pytest.approx(rms(error[2]))
    assert found.velocity_rmse_50 == pytest.approx(rms(error[2:52])) and found.velocity_rmse_all == pytest.approx(rms(error[2:]))
    assert found.pressure_rmse_50 == pytest.approx(rms(pressure[2:52])) and found.pressure_rmse_all == pytest.approx(rms(pressure[2:]))
    assert found.worst_step == 2 + int(np.argmax((error[2:] ** 2).mean(axis=(1, 2))))
    single = np.random.default_rng(5).normal(size=(58, S, 2))
    assert made.verify(u, p, single).velocity_rmse_1 == pytest.approx(rms((single - made.velocity[2:])[:, INSIDE]))
    late = made.velocity.copy()
    late[1, INSIDE] += 90.0  # what is shown is no error
    late[7, INSIDE] += [0.0, 2.0]
    late[9, INSIDE] += [2.0, 0.5]
    late[8, ~INSIDE] += 50.0
    assert made.verify(late, p).worst_step == 9
    assert made.verify(made.velocity, p).worst_step == 2


@pytest.mark.parametrize("force, swing, sheds", [({}, 0.161, True), ({}, 0.159, False), ({"length": None}, 9.0, False),
                                                 ({"speed": None}, 9.0, False)])
def test_a_lift_sheds_when_its_coefficient_swings_by_more_than_two_hundredths(force, swing, sheds):
    """Density 2, 4 m/s, 0.5 m: a coefficient of one is 8 N/m. A wave of eight frames: 0.125 / 0.25 s x 0.5 m / 4 m/s."""
    made = reference(scene=scene_of(**force))
    lift = swing / 2 * np.cos(2 * np.pi * np.arange(24) / 8 + np.pi / 8) / np.cos(np.pi / 8)
    found = made._strouhal(lift)
    assert found == pytest.approx(0.0625) if sheds else math.isnan(found)


def test_four_lifts_are_the_fewest_and_without_a_force_there_is_none():
    made = reference()
    made_up = np.array([-9.0, 9.0, -9.0, 9.0])
    assert made._strouhal(made_up) == pytest.approx(0.5 / SPAN * 0.5 / 4.0) and math.isnan(made._strouhal(np.array([9.0, -9.0, 9.0])))
    made.scene.force = None
    assert math.isnan(made._strouhal(made_up))


def behind(**body):
    """Nodes in rows of 1/8 m around a hole of radius 1/8 m at (1/2, 1/4)."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 1.7, 0.125), np.arange(0, 0.6, 0.125)))
    scene = scene_of()
    scene.body = SimpleNamespace(**{"shape": "channel", "hole_centre": (0.5, 0.25), "hole_radius": 0.125} | body)
    return scene, np.stack([x, y, 0 * x], axis=1)


def test_spectra_are_taken_one_two_and_four_diameters_behind_the_rear_as_far_as_there_is_fluid():
    """The rear is at 5/8 m: 7/8, 9/8 and 13/8 m, of which the last is the outlet; of half the hole at 0.5125 m 1/8, 1/4, 1/2 m behind."""
    small = {"hole_radius": 0.0625, "hole_centre": (0.45, 0.27)}
    for body, wanted in (({}, [0.875, 1.125]), (small, [0.625, 0.75, 1.0]), ({"shape": "plate"}, []), ({"hole_centre": None}, []),
                         ({"hole_radius": None}, [])):
        scene, points = behind(**body)
        made = reference(scene=scene, mesh=SimpleNamespace(points=points))
        np.testing.assert_allclose(points[made._points, 0], wanted, atol=1e-12)
        np.testing.assert_allclose(points[made._points, 1], 0.25, atol=1e-12)


def waves(frames, size):
    scene, points = behind()
    t = np.arange(frames)[:, None]
    u = np.zeros((frames, len(points), 2))
    u[..., 1] = size * np.sin(2 * np.pi * t * (0.1 + 0.05 * points[:, 0]) + points[:, 1]) + 0.2 * t / frames
    u[..., 0] = 5.0
    return u, scene, points


@pytest.mark.parametrize("frames, first, known", [(32, 0, True), (31, 0, True), (30, 0, False), (40, 23, True), (40, 24, False)])
def test_a_spectrum_is_of_the_velocity_across_in_sixteen_late_frames_at_least(frames, first, known):
    (true, scene, points), (u, _, _) = waves(frames, 1.0), waves(frames, 0.7)
    made = FlowReference(true, None, np.ones(len(points), bool), SimpleNamespace(points=points), scene, SPAN, first)
    found = made._spectrum(u, 5.0)
    late = max(frames // 2, first + 1)
    if not known:
        assert math.isnan(found) and frames - late < 16
        return
    at, total = [int(np.argmin(abs(points[:, 0] - x) + abs(points[:, 1] - 0.25))) for x in (0.875, 1.125)], []
    for flow in (u, true):
        rows = flow[late:, at, 1]
        n = len(rows)
        window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / (n - 1))
        turn = np.exp(-2j * np.pi * np.outer(np.arange(n // 2 + 1), np.arange(n)) / n)
        total.append(abs(turn @ ((rows - rows.mean(axis=0)) * window[:, None])))
    assert found == pytest.approx(np.sqrt(((total[0] - total[1]) ** 2).sum() / (total[1] ** 2).sum()))
    swing = np.ptp(true[late:, at, 1], axis=0).max()
    assert math.isnan(made._spectrum(u, 100.1 * swing)) and not math.isnan(made._spectrum(u, 99.9 * swing))


def test_a_frequency_counts_from_the_first_rise_to_the_last_between_frames():
    """About the middle of largest and smallest, 0: rises at 0.5, 3 and, a quarter of the way, 6.25; two periods in 5.75 frames."""
    assert frequency([-1.0, 1.0, -1.0, 0.0, 1.0, 0.5, -0.25, 0.75]) == pytest.approx(2 / 5.75)
    assert frequency([10.0, 12.0, 10.0, 12.0]) == pytest.approx(0.5)
    assert math.isnan(frequency([-1.0, 1.0, -1.0])) and math.isnan(frequency([1.0, 1.0]))


def test_what_does_not_change_keeps_what_is_shown_from_then_on():
    velocity = np.arange(24.0).reshape(4, 3, 2)
    found = nothing_changes(velocity, 0, np.array([False, True, True]))
    assert (found[0] == velocity[0]).all() and (found[1:, 1:] == velocity[0, 1:]).all() and (found[:, 0] == velocity[:, 0]).all()


def test_a_root_mean_square_that_overflows_is_infinite_and_of_what_is_none_none():
    with np.errstate(over="ignore"):
        assert _rms(np.array([1e200, 1.0])) == math.inf
    assert math.isnan(_rms(np.array([1.0, math.nan]))) and _rms(np.array([3.0, 4.0])) == pytest.approx(math.sqrt(12.5))

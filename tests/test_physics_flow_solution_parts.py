"""What is said of a flow beside its frames: places, what was computed, what should be looked at, and how its frames are cut."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from physics.flow import solution
from physics.flow.conditions import conditions_of
from physics.flow.frames import NoFlow
from physics.flow.solution import RESOLVED, FlowSolution, solve_flow
from physics.flow.space import FlowSpace
from physics.flow.stationary import NoStationaryFlow
from physics.flow.stored import computed_mesh, stored
from physics.scene import Body, FlowScene
from physics.scene.flow import FlowSteps, Fluid, Inflow, Outflow, Wall
from physics.schema import WorkError
from tests.flows import channel_flow


def plate(order=3, steps=None, **what):
    body = Body(shape="plate", length=3.0, width=2.0, cells=(6, 4), cell="triangle")
    what = {"inflow": (Inflow(where="x-min", speed=1.0),), "outflow": (Outflow(where="x-max"),)} | what
    fluid = Fluid(density=2.0, viscosity=1.0, order=order)
    return FlowScene(body=body, fluid=fluid, steps=steps or FlowSteps(count=2, duration=0.5), **what)


@pytest.mark.parametrize("order", (2, 3))
def test_stored_nodes_are_of_walls_before_inlets_and_outlets_corners_too(order):
    scene = plate(order)
    space = FlowSpace(computed_mesh(scene), order)
    where = stored(scene, space)
    x, y = np.round(where.mesh.points[:, :2] - where.mesh.points[:, :2].min(axis=0), 9).T
    wanted = np.select([(y == 0) | (y == 2), x == 0, x == 3], [3, 1, 2], 0)
    found = solution._places(where, space, conditions_of(scene, space), scene)
    np.testing.assert_array_equal(found, wanted)
    assert found.dtype == np.int8 and (solution.FLUID, solution.INLET, solution.OUTLET, solution.WALL) == (0, 1, 2, 3)


def rows(unresolved, energy, sizes=(), iterations=(0, 3, 4)):
    return {"unresolved": np.array(unresolved), "kinetic_energy": np.array(energy), "step_size": np.array(sizes),
            "iterations": np.array(iterations, float)}


def test_what_is_not_resolved_counts_past_the_start_and_by_the_speed_of_its_frame():
    """The fastest frame has the energy 16; of five frames the last three count: 0.2 x 1/2, 0.05 x 1, 0.3 x 1/4."""
    assert solution._unresolved(rows([9, 9, 0.2, 0.05, 0.3], [0, 0, 4, 16, 1])) == pytest.approx(0.1)
    assert solution._unresolved(rows([9, 0.2, 0.05, 0.3], [0, 4, 16, 1])) == pytest.approx(0.075)
    assert solution._unresolved(rows([0.5], [0.0])) == 0.0


@pytest.mark.parametrize("order, share", [(2, 0.06), (3, 0.03)])
def test_cells_are_too_large_past_six_or_three_hundredths(order, share):
    scene = plate(order)
    space = SimpleNamespace(mesh=SimpleNamespace(remarks=("of the mesh",), middles={}, cells=np.zeros(48)),
                            velocity=SimpleNamespace(points=np.zeros(5)), pressure=SimpleNamespace(points=np.zeros(3)))
    assert RESOLVED[order] == share
    for part, fair in ((share, True), (1.01 * share, False)):
        found = rows([0, part, part], [1, 1, 1])
        remarks, said = solution._remarks(scene, space, found), solution._model(scene, space, found)["resolution"]
        assert remarks[0] == "of the mesh" and len(remarks) == (1 if fair else 2)
        assert said == (f"{part:.2%} of the velocity is in functions of order {order} alone, at most, past the start: "
                        + (f"fair up to {share:.0%}" if fair else f"not fair: past {share:.0%} the cells are too large"))
        if not fair:
            words = f"the cells are too large for this flow: {part:.1%} of the velocity is in functions of order {order}"
            assert remarks[1].startswith(words)


def model_of(scene, *, curved=False, sizes=(0.0, 0.1, 0.05)):
    space = SimpleNamespace(mesh=SimpleNamespace(remarks=(), middles={2: 0} if curved else {}, cells=np.zeros(48)),
                            velocity=SimpleNamespace(points=np.zeros(5)), pressure=SimpleNamespace(points=np.zeros(3)))
    return solution._model(scene, space, rows([0, 0, 0], [1, 1, 1], sizes))


def test_the_model_says_what_was_computed():
    said = model_of(plate())
    assert list(said) == ["elements", "time", "resolution", "fluid"]
    assert said["elements"] == "Taylor-Hood: velocity of order 3, pressure of order 2, 10 and 3 unknowns on 48 triangles"
    assert "7 steps of 0.05 to 0.1 s," in said["time"]
    assert model_of(plate(), curved=True)["elements"].endswith("triangles, curved sides")
    still = model_of(plate(steps=FlowSteps(stationary=True)))["time"]
    assert still == "none: the stationary flow by Newton's method, 7 solves; it need not be stable"
    assert "time" not in model_of(plate(), sizes=(0.0,))


@pytest.mark.parametrize("viscosity, said", [(0.2 * 0.1 / 190, "fair below about 190"), (0.2 * 0.1 / 191, "not fair: past")])
def test_a_cylinders_wake_is_plane_up_to_a_reynolds_number_of_190(viscosity, said):
    scene = channel_flow(fluid={"density": 1.0, "viscosity": viscosity * (1 + 1e-12)})
    found = model_of(scene)
    assert found["two dimensions"].startswith(said) and found["two dimensions"].endswith(" (Williamson 1996)")
    assert found["Reynolds number"] == f"{scene.reynolds_number:.4g} = speed 0.2 m/s x length 0.1 m / {viscosity:.4g} m2/s"
    assert "Reynolds number" not in model_of(replace(scene, force=None))


@pytest.mark.parametrize("scene, blocks", [
    # 0.25 s a frame; the fastest over a tenth of the longer side, 0.3 m: 5 x 0.25 x speed / 0.3 / 3, rounded up, one at least
    (plate(), 2), (plate(inflow=(Inflow(where="x-min", speed=-2.0),)), 3), (plate(inflow=()), 1), (plate(inflow=(), outflow=()), 1),
    (plate(wall=(Wall(where="y-min", velocity=(0.0, -1e7)),)), 10_000)])
def test_a_frame_is_cut_into_blocks_by_its_fastest_fluid(scene, blocks, monkeypatch):
    taken = []
    monkeypatch.setattr(solution, "advance", lambda stepper, until, blocks: taken.append((until, blocks)))
    mesh = SimpleNamespace(points=np.array([[0.0, 0, 0], [3.0, 2.0, 0]]))
    solution._go_on(scene, SimpleNamespace(space=SimpleNamespace(mesh=mesh)), 2)
    assert taken == [(0.5, blocks)]


def test_a_solution_tells_its_frames_and_its_coefficients():
    parts = dict(mesh="a mesh", velocity=np.array([[[0.0, 0, 0]], [[3.0, 4.0, 0]]], np.float32), pressure=np.zeros((2, 1, 1), np.float32),
                 per_frame={"drag": np.array([1.0, 6.0])}, node_place=np.zeros(1, np.int8), model={}, remarks=(), seconds=1.0, set_up=0.5)
    found = FlowSolution(scale=2.0, **parts)
    assert repr(found) == "FlowSolution(1 frames of a mesh: largest speed 5 m/s)"
    assert repr(replace(found, failure="frame 2: no")) == "FlowSolution(1 frames of a mesh: frame 2: no)"
    assert found.coefficients("drag").tolist() == [0.5, 3.0] and found.coefficients("lift") is None
    assert replace(found, scale=None).coefficients("drag") is None
    assert (found.factorisations, found.resumed, found.failure) == (0, 0, "")


@pytest.mark.parametrize("error", [NoFlow, NoStationaryFlow])
def test_each_frame_is_told_and_what_could_not_be_followed_is_said(monkeypatch, error):
    """Two frames of four are reached, by three and no steps more; the first, at rest, is not told."""
    steps = iter([3, 0])

    def go_on(scene, stepper, frame):
        if frame == 3:
            raise error("too fast")
        stepper.memory = replace(stepper.memory, steps=stepper.memory.steps + next(steps), time=0.05 * frame, u=stepper.memory.u + frame)

    monkeypatch.setattr(solution, "_go_on", go_on)
    told, scene = [], plate(2, FlowSteps(count=4, duration=0.2))
    found = solve_flow(scene, on_step=told.append, partial=True)
    assert told == [1, 2] and found.failure == "frame 3: too fast" and found.per_frame["iterations"].tolist() == [0, 3, 0]
    assert found.velocity.shape[0] == found.pressure.shape[0] == 3 and found.resumed == 0 and found.scale is None
    assert 0 <= found.set_up and 0 < found.seconds and found.factorisations == 0
    assert found.per_frame["step_size"].tolist() == [0, 0, 0]
    inlet = found.node_place == 1
    assert found.velocity[0, inlet, 0].max() > 0.9 and not found.velocity[0, found.node_place == 0].any()
    steps = iter([3, 0])
    with pytest.raises(WorkError, match="^frame 3: too fast$"):
        solve_flow(scene)

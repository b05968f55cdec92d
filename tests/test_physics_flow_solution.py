"""The answer to a flow scene: frames, places, restart, step sizes, the file of it, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

import fidelity
from datagen.files.trajectory import INFLOW, OUTFLOW, WALL, problems, read_trajectory
from physics.flow import frames
from physics.flow.conditions import conditions_of
from physics.flow.frames import NoFlow, advance, count, rounded
from physics.flow.solution import solve_flow
from physics.flow.space import FlowSpace
from physics.flow.stepping import Memory, Stepper
from physics.flow.stored import computed_mesh, stored
from physics.schema import InputError, WorkError
from tests.flows import channel_flow


def stepper_of(scene):
    space = FlowSpace(computed_mesh(scene), scene.order)
    rest = Memory(0.0, np.zeros((len(space.velocity.points), 2)), np.zeros(len(space.pressure.points)))
    return Stepper(space, conditions_of(scene, space), scene.fluid.viscosity / scene.fluid.density, rest)


def test_frames_hold_what_the_scene_gives_at_the_boundary():
    """At the inlet the parabola times the ramp, at the walls and the cylinder nothing; the corners are of the walls."""
    scene = channel_flow()
    found = solve_flow(scene)
    x, y = found.mesh.points[:, :2].T
    for frame, factor in ((0, 0.0), (1, 0.5), (4, 1.0)):
        inlet = found.node_place == 1
        wanted = 0.3 * factor * 4 * y * (0.41 - y) / 0.41**2
        np.testing.assert_allclose(found.velocity[frame, inlet, 0], wanted[inlet], rtol=1e-6, atol=1e-8)
    assert not found.velocity[:, found.node_place == 3].any()
    assert (found.node_place[(x == 0) & ((y == 0) | (y == 0.41))] == 3).all()
    assert (found.node_place[np.hypot(x - 0.2, y - 0.2) < 0.0501] == 3).all()
    assert (found.node_place == 2).sum() == (found.node_place[x > 0.8 - 1e-9] == 2).sum() > 3
    assert found.per_frame["divergence"][-1] < 1e-3 * 0.3 / 0.1
    assert found.per_frame["kinetic_energy"][0] == 0
    assert found.per_frame["drag"][-1] > 0


def test_density_scales_pressure_force_and_energy_alone():
    light, heavy = solve_flow(channel_flow()), solve_flow(channel_flow(fluid={"density": 1000.0, "viscosity": 1.0}))
    np.testing.assert_allclose(heavy.velocity, light.velocity, atol=1e-6)
    for name in ("drag", "kinetic_energy", "pressure_difference"):
        np.testing.assert_allclose(heavy.per_frame[name], 1000 * light.per_frame[name], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(heavy.coefficients("drag"), light.coefficients("drag"), rtol=1e-6, atol=1e-6)


def test_stored_cells_are_quarters_with_the_cubic_at_their_corners():
    scene = channel_flow()
    space = FlowSpace(computed_mesh(scene), 3)
    where = stored(scene, space)
    assert len(where.mesh.cells) == 4 * len(space.mesh.cells)
    x = space.velocity.points
    cubic = np.stack([x[:, 0] ** 3 - x[:, 1], x[:, 0] * x[:, 1] ** 2], axis=1)
    at = where.mesh.points[:, :2]
    straight = ~np.isin(np.arange(len(at)), where.mesh.places["hole"])
    wanted = np.stack([at[:, 0] ** 3 - at[:, 1], at[:, 0] * at[:, 1] ** 2], axis=1)
    np.testing.assert_allclose(where.velocity(cubic)[straight, :2], wanted[straight], atol=1e-7)
    a, b, c = (where.mesh.points[where.mesh.cells[:, i], :2] for i in range(3))
    assert ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).min() > 0
    np.testing.assert_allclose(np.hypot(*(at[where.mesh.places["hole"]] - 0.2).T), 0.05, rtol=1e-9)


def test_a_run_that_was_cut_off_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    """Between two frames the step changes, so history and corrections must come back too."""
    monkeypatch.setattr("physics.journal.EVERY", 0.0)
    scene = channel_flow(steps={"count": 6, "duration": 0.12})
    whole = solve_flow(scene)

    class Killed(Exception):
        pass

    def kill(step):
        if step == 3:
            raise Killed

    with pytest.raises(Killed):
        solve_flow(scene, journal=tmp_path / "part", on_step=kill)
    rest = solve_flow(scene, journal=tmp_path / "part")
    assert rest.resumed == 3
    assert np.array_equal(rest.velocity, whole.velocity)
    assert np.array_equal(rest.pressure, whole.pressure)
    for name, values in whole.per_frame.items():
        assert np.array_equal(rest.per_frame[name], values), name
    with pytest.raises(InputError, match="another scene"):
        solve_flow(replace(scene, name="other"), journal=tmp_path / "part")


def test_steps_are_as_long_as_stability_lets_them_be():
    """Twice the speed, twice as many; never past the limit."""
    slow, fast = (stepper_of(channel_flow(inflow=[{"speed": speed}])) for speed in (1.0, 2.0))
    for stepper in (slow, fast):
        for k in range(1, 31):
            advance(stepper, 0.01 * k)
        assert stepper.memory.size * stepper.space.rate(stepper.memory.u) < frames.OVER * frames.COURANT[3]
    assert count(fast, 0.01) / count(slow, 0.01) == pytest.approx(2, rel=0.3)
    assert [rounded(n) for n in (0.2, 1, 3.1, 16, 17.5, 33, 70, 1000)] == [1, 1, 4, 16, 18, 34, 72, 1024]


def test_steps_that_are_too_long_are_taken_again_and_never_believed(monkeypatch):
    """Ten times too long they are unstable: the block is done again with shorter ones, or, where that is not allowed, nothing comes."""
    stepper = stepper_of(channel_flow(inflow=[{"speed": 2.0}]))
    for k in range(1, 31):
        advance(stepper, 0.01 * k)
    before, right = stepper.memory, count(stepper, 0.1)
    monkeypatch.setattr(frames, "count", lambda stepper, span: max(1, right // 10))
    advance(stepper, 0.4)
    assert stepper.memory.steps - before.steps >= right / 1.2
    taken = stepper.memory.u
    stepper.memory = before
    monkeypatch.setattr(frames, "count", lambda stepper, span: 2 * right)
    advance(stepper, 0.4)
    assert abs(taken - stepper.memory.u).max() < 1e-2 * abs(taken).max()
    stepper.memory = before
    monkeypatch.setattr(frames, "count", lambda stepper, span: max(1, right // 10))
    monkeypatch.setattr(frames, "AGAIN", 0)
    with pytest.raises(NoFlow, match="stable|unstable"):
        advance(stepper, 0.4)
    assert stepper.memory is before


def test_what_does_not_converge_is_said_and_what_was_reached_is_kept(monkeypatch):
    scene = channel_flow()

    def fail(stepper, until, blocks=1):
        if until > 0.12:
            raise NoFlow("no flow after t = 0.1 s")
        return advance(stepper, until, blocks=blocks)

    monkeypatch.setattr("physics.flow.solution.advance", fail)
    with pytest.raises(WorkError, match="frame 3: no flow after"):
        solve_flow(scene)
    found = solve_flow(scene, partial=True)
    assert len(found.velocity) == 3
    assert found.failure == "frame 3: no flow after t = 0.1 s"


def test_simulate_writes_the_file_of_a_flow(tmp_path, capsys):
    scene = channel_flow(steps={"count": 2, "duration": 0.02})
    (tmp_path / "flow.toml").write_text(scene.to_toml())
    out = tmp_path / "flow.vtkhdf"
    assert fidelity.main(["simulate", str(tmp_path / "flow.toml"), "--out", str(out), "--json", "--csv", str(tmp_path / "t.csv")]) == 0
    said = json.loads(capsys.readouterr().out)
    trajectory = read_trajectory(out)
    assert problems(trajectory) == []
    assert set(trajectory.per_frame) == {"drag", "lift", "pressure_difference", "kinetic_energy", "divergence", "step_size", "iterations",
                                         "unresolved"}
    assert trajectory.fields["velocity"].shape == (3, said["nodes"], 3)
    assert trajectory.fields["pressure"].shape == (3, said["nodes"], 1)
    assert set(trajectory.node_kind) == {0, INFLOW, OUTFLOW, WALL}
    assert trajectory.extra["flow"]["reynolds_number"] == pytest.approx(20)
    assert trajectory.extra["step_seconds"] == pytest.approx(0.01)
    assert said["drag_coefficient"] == pytest.approx(trajectory.per_frame["drag"][-1] / (0.5 * 0.2**2 * 0.1))
    assert "0.2 m/s x length 0.1 m" in said["model"]["Reynolds number"]
    assert not (tmp_path / "flow.vtkhdf.part").exists()
    assert len((tmp_path / "t.csv").read_text().splitlines()) == 4


@pytest.mark.parametrize(("arguments", "words"), [
    (["--html", "a.html"], "--html: is for solids"), (["--fields", "stress"], "--fields: is for solids"),
    (["--set", "inflow[0].where=x-maxx"], "must be one of"),
    (["--set", "force.where=outlet", "--set", "outflow[0].where=inlet"], "another inflow")])
def test_what_simulate_cannot_do_with_a_flow_is_one_line(arguments, words, tmp_path, capsys):
    (tmp_path / "flow.toml").write_text(channel_flow().to_toml())
    assert fidelity.main(["simulate", str(tmp_path / "flow.toml"), "--out", str(tmp_path / "o.vtkhdf"), *arguments]) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert said.err.count("\n") == 1
    assert not (tmp_path / "o.vtkhdf").exists()

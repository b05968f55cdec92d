"""An error asked of a body in motion: how many steps of time, on which mesh, and what the frames between them are."""

from dataclasses import replace

import numpy as np
import pytest

from physics.accuracy.answer import answer
from physics.accuracy.estimate import distance
from physics.accuracy.meshes.ladder import families
from physics.accuracy.motion import FEWEST, Motions, beside, choose_motion, framed, in_time, numbers
from physics.equilibrium.state import NoEquilibrium
from physics.schema import InputError
from physics.solution import solve
from tests.scenes import beam

SIDES = {"length": 0.06, "width": 0.02, "height": 0.01}
SOFT = {"young_modulus": 1e6, "poisson_ratio": 0.3, "density": 1000.0}


def moving(count=20, duration=0.1, error=0.1, **changes):
    """A body of rubber in motion, free unless it is held."""
    return beam(**{"body": SIDES, "material": SOFT, "support": [],
                   "steps": {"count": count, "duration": duration, "dynamic": True, "error": error}} | changes)


def swinging(**changes):
    """Held at one end, under a load at the other that is there at once: some two periods."""
    return moving(**{"count": 40, "duration": 0.12, "support": [{"where": "x-min"}],
                     "load": [{"where": "x-max", "traction": [0.0, 0.0, -60.0], "sudden": True}]} | changes)


def motions(scene, steps=FEWEST):
    kinds = sorted(families(scene), key=lambda family: family.order)
    return Motions(scene, kinds, "displacement", 1e-6, steps), kinds[-1]


def test_steps_fit_the_frames():
    assert numbers(20)[:8] == [2, 4, 5, 10, 20, 40, 80, 160] and numbers(1)[:3] == [1, 2, 4] and max(numbers(7)) > 50_000
    assert all(numbers(frames)[-1] >= 1.5 * n for frames in (20_011, 999_983) for n in numbers(frames)[:2])  # primes: also beside 2 a frame
    found, _ = motions(moving(count=20), 10)
    assert beside(found) == (5, 20)
    found.count = 20
    assert beside(found) == (10, 40)
    odd, kind = motions(moving(count=17))  # no fewer than 17 fit
    in_time(odd, kind, 0.5, 1.0)
    assert odd.count in (34, 68) and beside(odd)[0] in (17, 34)


def test_of_many_steps_a_frame_has_the_last_state_the_mean_force_and_all_the_work():
    scene = swinging(body=SIDES | {"cells": [4, 2, 2], "cell": "hexahedron"}, steps={"count": 6, "duration": 0.02, "dynamic": True})
    full, two = solve(scene), solve(replace(scene, steps=replace(scene.steps, count=2)), substeps=3)
    for name in ("displacement", "kinetic_energy", "energy"):
        np.testing.assert_allclose(getattr(two, name), getattr(full, name)[[0, 3, 6]], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(two.reaction[1], full.reaction[1:4].mean(axis=0), rtol=1e-9)
    assert two.newton_iterations.tolist() == [0, full.newton_iterations[1:4].sum(), full.newton_iterations[4:].sum()]
    assert two.relative_residual[2] == pytest.approx(full.relative_residual[4:].max(), rel=1e-3) and full.reaction[1:4].std() > 0
    with pytest.raises(InputError, match="substeps: of a body in motion"):
        solve(replace(scene, steps=replace(scene.steps, dynamic=False), load=()), substeps=2)


def test_of_few_steps_frames_between_lie_on_cubics():
    """A path that is a cubic in time is kept; its residual is that of the step which passes by, and no energy is below zero."""
    full = solve(replace(swinging(body=SIDES | {"cells": [4, 2, 2], "cell": "hexahedron"}, steps={
        "count": 4, "duration": 0.02, "dynamic": True})))
    t = np.linspace(0, 1, 13)
    cubic = replace(full, displacement=(t**3 - t**2)[::3, None, None] * np.ones_like(full.displacement),
                    kinetic_energy=(np.array([0.0, 1e-9, 1.0, 0.0, 0.0])))
    found = framed(cubic, 12)
    np.testing.assert_allclose(found.displacement[:, 0, 0], t**3 - t**2, atol=1e-14)
    assert len(found.reaction) == len(found.energy) == 13 and found.kinetic_energy.min() == 0.0 and found.knots == (0, 3, 6, 9, 12)
    assert found.newton_iterations[[0, 3, 6, 9, 12]].tolist() == full.newton_iterations.tolist()
    assert found.newton_iterations.sum() == full.newton_iterations.sum()
    assert found.relative_residual.tolist() == full.relative_residual[[0, *np.repeat([1, 2, 3, 4], 3)]].tolist()


def test_a_body_that_falls_needs_the_fewest_steps_and_falls_as_galileo_says():
    """g t^2 / 2, which steps of any length have exactly: 981 mm after 0.447 s."""
    scene = moving(count=80, duration=0.447, load=[{"acceleration": [0.0, 0.0, -9.81], "sudden": True}], error=0.01)
    found = choose_motion(scene)
    t = np.linspace(0, 0.447, 81)
    fallen = -9.81 / 2 * t**2
    np.testing.assert_allclose(found.solution.displacement[:, :, 2], fallen[:, None] * np.ones(len(found.solution.mesh.points)), atol=1e-6)
    assert found.verdict.reached and found.verdict.estimated < 1e-5 and found.scene.steps.error is None
    assert found.solution.model["steps"] == "16 of time for 80 frames" and len(found.solution.displacement) == 81


def test_a_body_that_falls_has_no_stress():
    """What rounding makes of it falls with no number of steps or cells."""
    scene = moving(count=20, load=[{"acceleration": [0.0, 0.0, -9.81], "sudden": True}])
    found = choose_motion(replace(scene, steps=replace(scene.steps, quantity="stress")), most=300)
    assert found.verdict.reached and found.verdict.estimated == 0.0 and found.solution.steps_of_time == 20


def test_what_time_makes_of_the_error_is_what_sixteen_times_as_many_steps_say():
    """Second order is the most that the order seen may be; a load that is there at once has modes without end in it, and less."""
    found, kind = motions(swinging(material=SOFT | {"law": "linear"}, error=0.02))
    known, enough, rough = in_time(found, kind, 0.01, 0.2)
    assert known.how == "seen" and 1.4 < known.order <= 2.0 and known.error <= 0.01 and rough < enough
    finest = found.moved(kind, kind.base, 16 * enough)
    off = distance(found.moved(kind, kind.base, enough).values, finest.values, found.weights)
    assert off <= 0.01 < 10 * off
    assert distance(found.moved(kind, kind.base, rough).values, finest.values, found.weights) < 0.2


@pytest.mark.parametrize("error", [0.1, 0.05])
def test_the_error_that_is_asked_is_kept(error):
    scene = swinging(error=error)
    found = choose_motion(scene)
    assert found.verdict.reached and found.verdict.estimated <= error
    fine, kind = motions(scene, 640)
    truth = fine(kind, (18, 5, 3))
    off = distance(fine.of(found.scene, found.solution, fine.compared), truth.values, fine.weights)
    assert off <= error < 12 * off


def test_a_table_says_what_each_choice_makes_of_the_error():
    _, _, verdict = answer(swinging())
    rows = {row["choice"]: row for row in verdict.rows}
    assert list(rows)[:3] == ["cells along x", "cells along y", "cells along z"]
    assert rows["kinematics"]["taken"] == "finite strain" and "for 40 frames, held against" in rows["steps of time"]["taken"]
    parts = sum(row["error"] for name, row in rows.items() if name.startswith("cells") or name in ("tolerance", "steps of time"))
    assert rows["the whole scene"]["error"] == pytest.approx(parts) == pytest.approx(verdict.estimated)
    assert rows["the search"]["taken"].endswith("motions") and verdict.quantity == "displacement"


def test_more_steps_than_may_be_taken_are_not_promised(monkeypatch):
    monkeypatch.setattr("physics.accuracy.motion.MOST", 60)
    found = choose_motion(swinging(error=0.005, duration=1.0), most=300)
    assert not found.verdict.reached and found.verdict.estimated > 0.005


def test_a_motion_that_cannot_be_followed_says_so(monkeypatch):
    def lost(*args, **kwargs):
        return replace(solve(*args, **kwargs), failure="no motion at step 3: lost")

    monkeypatch.setattr("physics.accuracy.motion.solve", lost)
    with pytest.raises(NoEquilibrium, match=r"in 20 steps of time: no motion at step 3: lost"):
        choose_motion(swinging())


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "hexahedron", "tetrahedron"])
@pytest.mark.parametrize("load", [{"sudden": True}, {}, {"steps": [0.0, 0.5, 1.0], "factor": [0.0, 1.0, 1.0]}])
def test_all_nodes_of_a_free_body_of_second_order_fall_alike(cell, load):
    plane = cell in ("triangle", "quadrilateral")
    sides = {"shape": "plate", "length": 0.06, "width": 0.02, "cells": [4, 2]} if plane else SIDES | {"cells": [3, 2, 1]}
    scene = moving(body=sides | {"cell": cell, "order": 2}, load=[{"acceleration": [0.0, -9.81, 0.0], **load}],
                   steps={"count": 5, "duration": 0.2, "dynamic": True})
    fallen = solve(scene).displacement[-1]
    assert abs(fallen - fallen.mean(axis=0)).max() < 1e-7 * abs(fallen).max() and fallen[:, 1].max() < -0.04

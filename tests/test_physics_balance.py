"""The equations of a scene before anything is solved: what is held, loaded and near, worked out on paper."""

from dataclasses import replace

import numpy as np
import pytest

from physics.equilibrium.balance import CONTACT_STIFFNESS, GAP_TOLERANCE, Balance, cell_size, could_be_plane
from physics.equilibrium.state import State
from physics.mesh.build import build_mesh
from physics.schema import InputError
from tests.scenes import beam

# Cells of 20 x 5 x 4 mm: 3 x 4 x 2 of them.
BODY = {"length": 0.06, "width": 0.02, "height": 0.008, "cells": [3, 4, 2], "cell": "hexahedron"}
SUPPORT = [{"where": "x-min", "fixed": "xyz"}]


def balance(**changes):
    scene = beam(**({"body": BODY, "support": SUPPORT} | changes))
    return Balance(scene, build_mesh(scene.body))


def ball(*path, radius=0.01, **more):
    return {"shape": "sphere", "radius": radius, "path": [list(point) for point in path]} | more


def moved(mesh, by):
    return replace(mesh, points=mesh.points + by)


def test_the_size_of_a_cell_is_the_median_of_its_edges():
    """Edges: 3 * 15 of 20 mm, 4 * 12 of 5 mm, 2 * 20 of 4 mm: of 133 the 67th is one of 5 mm; 2 x 1 x 1 cells: 8 of 30, 6 + 6 others."""
    assert cell_size(build_mesh(beam(body=BODY).body)) == pytest.approx(0.005, rel=1e-12)
    few = beam(body=BODY | {"cells": [2, 1, 1]})  # 8, 6 and 6 edges of 30, 20 and 8 mm: the median of 20 is one of 20 mm
    assert cell_size(moved(build_mesh(few.body), [1.0, -2.0, 3.0])) == pytest.approx(0.02, rel=1e-12)


def test_rounding_takes_over_below_a_thousand_eps_e_h_l():
    found = balance(material={"young_modulus": 2e6, "poisson_ratio": 0.3})
    # 2.2e-16 * 1000 * 2e6 Pa * 5 mm * 60 mm, the range of all coordinates
    assert found.floor == pytest.approx(1e3 * 2.0**-52 * 2e6 * 0.005 * 0.06, rel=1e-12)


def test_contact_is_20000_times_as_stiff_as_a_cell():
    """c = h / (2e4 E A): at a corner of the top an area of 20 x 5 mm / 36 by Simpson's rule, for each of its three faces."""
    found = balance(material={"young_modulus": 2e6, "poisson_ratio": 0.3}, obstacle=ball((0.03, 0.01, 0.03)))
    surface = found.contact.surface
    corner = int(np.argmin(np.linalg.norm(surface.positions(found.mesh.points) - [0.06, 0.02, 0.008], axis=1)))
    area = (20 * 5 + 20 * 4 + 5 * 4) * 1e-6 / 36
    assert found.contact.softness[corner] == pytest.approx(0.005 / (2e4 * 2e6 * area), rel=1e-12)
    assert (CONTACT_STIFFNESS, GAP_TOLERANCE) == (2e4, 1e-6)


def test_held_nodes_alone_are_left_out_of_contact():
    """A node held in one component is in contact; one held in all of them is not, nor are points between such nodes."""
    support = [*SUPPORT, {"where": "x-max", "fixed": "y"}]
    found = balance(support=support, obstacle=ball((0.03, 0.01, 0.03)))
    x = found.contact.surface.positions(found.mesh.points)[:, 0]
    assert (x > 1e-9).all() and (x > 0.06 - 1e-9).sum() == 9 * 5


def test_forces_at_rest_loads_and_weights():
    """The load is the weight and the traction; both as at the last step."""
    load = [{"acceleration": [1.0, 2.0, -9.81]}, {"where": "x-max", "traction": [3e3, 0.0, -1e3]}, {"acceleration": [0.0, 0.0, 1.0]}]
    found = balance(material={"young_modulus": 1e6, "poisson_ratio": 0.4, "density": 700.0}, load=load)
    mass, area = 700 * 0.06 * 0.02 * 0.008, 0.02 * 0.008
    assert found.load.sum(axis=0) == pytest.approx([mass + 3e3 * area, 2 * mass, -8.81 * mass - 1e3 * area], rel=1e-10)
    top = found.mesh.points[:, 0] > 0.06 - 1e-9
    x = (found.load * [0, 1, 0]).sum(axis=1) @ found.mesh.points / (2 * mass)
    assert x == pytest.approx([0.03, 0.01, 0.004], rel=1e-9)  # the weight's centre
    assert found.load[~top, 0].sum() == pytest.approx(mass * 5 / 6, rel=1e-9)  # half a cell of three stands at the end
    assert not balance().load.any()


def test_the_reaction_is_that_of_supports_that_move_or_of_all():
    ends = [{"where": "x-min", "fixed": "xyz"}, {"where": "x-max", "fixed": "z"}]
    both = balance(support=ends)
    x = both.mesh.points[:, 0]
    assert both.bearing.tolist() == np.flatnonzero((x < 1e-9) | (x > 0.06 - 1e-9)).tolist() and len(both.bearing) == 30
    assert not both.target.any() and both.fixed.sum() == 3 * 15 + 15
    drawn = balance(support=[ends[0], ends[1] | {"displacement": [0.0, 0.0, -0.002]}])
    assert drawn.bearing.tolist() == np.flatnonzero(x > 0.06 - 1e-9).tolist()
    assert drawn.target[drawn.bearing] == pytest.approx(np.tile([0, 0, -0.002], (15, 1))) and (drawn.target != 0).sum() == 15


def test_clearance_is_the_gap_of_the_body_at_rest_along_the_path():
    """A ball of 10 mm straight above a node of the top face, 8 mm high, that goes down by 12 mm in two legs."""
    found = balance(obstacle=ball((0.02, 0.01, 0.022), (0.02, 0.01, 0.018), (0.02, 0.01, 0.010)))
    for fraction, gap in ((0.0, 0.004), (0.25, 0.002), (0.5, 0.0), (0.75, -0.004), (1.0, -0.008)):
        assert found.clearance(fraction) == pytest.approx(gap, abs=1e-12)
    assert balance().clearance(0.5) == np.inf


def test_the_body_rests_until_it_is_touched_loaded_or_moved():
    h = 0.005
    path = ball((0.02, 0.01, 0.0181), (0.02, 0.01, 0.0179))  # touches at half of it
    found = balance(obstacle=path)
    assert found.rests(0.0) and found.rests(0.49) and not found.rests(0.51) and not found.rests(1.0)
    just = 0.5 + 1e-6 * h / 0.0002  # a millionth of a cell deep
    assert found.rests(just - 1e-7) and not found.rests(just + 1e-7)
    assert not balance(obstacle=path, load=[{"acceleration": [0.0, 0.0, 1.0]}]).rests(0.0)
    assert not balance(support=[SUPPORT[0] | {"displacement": [0.0, 0.001, 0.0]}]).rests(0.5)
    assert balance().rests(1.0)


def test_a_stride_is_the_way_along_the_path_over_half_of_the_narrower():
    """Forth by 30 mm and aside by 40 mm at equal fractions; the body is 8 mm high, a ball of 3 mm is 6 mm wide."""
    path = [(0.02, 0.01, 0.1), (0.05, 0.01, 0.1), (0.05, 0.05, 0.1)]
    wide = balance(obstacle=ball(*path))
    assert wide.stride(0.0, 0.1) == pytest.approx(0.006 / 0.004)
    assert wide.stride(0.5, 1.0) == pytest.approx(0.040 / 0.004)
    assert wide.stride(0.4, 0.6) == pytest.approx((0.006 + 0.008) / 0.004)  # round the corner, not straight
    assert wide.stride(0.0, 1.0) == pytest.approx(0.070 / 0.004)
    assert wide.stride(0.3, 0.3) == 0
    assert balance(obstacle=ball(*path, radius=0.003)).stride(0.4, 0.6) == pytest.approx(0.014 / 0.003)
    assert balance(obstacle=ball(path[0])).stride(0.0, 1.0) == balance().stride(0.0, 1.0) == 0


def test_what_is_not_held_or_starts_in_the_body_is_refused():
    loose = [{"where": "x-min", "fixed": "yz"}, {"where": "x-max", "fixed": "yz"}]
    with pytest.raises(InputError, match="^support: 1 rigid motion of the body left free; fix more components$"):
        balance(support=loose, load=[{"acceleration": [0.0, 0.0, 1.0]}])
    with pytest.raises(InputError, match="^support: 3 rigid motions of"):
        balance(support=[{"where": "x-min", "fixed": "x"}], obstacle=ball((0.03, 0.01, 0.03)))
    with pytest.raises(InputError, match="1 rigid motion of"):
        balance(support=[loose[0], loose[1] | {"displacement": [0.0, 0.001, 0.0]}])
    assert balance(support=loose).fixed.sum() == 2 * 30  # nothing is asked of it
    time = {"count": 2, "dynamic": True, "duration": 0.01}
    assert balance(support=loose, load=[{"acceleration": [0.0, 0.0, 1.0]}], steps=time).load.any()  # it may fly
    with pytest.raises(InputError, match="the obstacle starts 0.00123 m inside the body; start it outside"):
        balance(obstacle=ball((0.02, 0.01, 0.018 - 0.00123)))
    assert balance(obstacle=ball((0.02, 0.01, 0.018 - 0.9e-6 * 0.005))).clearance(0) < 0
    with pytest.raises(InputError, match="inside the body"):
        balance(obstacle=ball((0.02, 0.01, 0.018 - 1.1e-6 * 0.005)))


def test_an_obstacle_wholly_within_a_body_is_refused_and_one_in_its_hollow_is_not():
    """No facet of the body is near such an obstacle, so that it would move through the body and nothing would happen."""
    fine = BODY | {"cells": [12, 8, 4]}
    within = [ball((0.03, 0.01, 0.004), radius=0.002), ball((0.03, 0.01, 0.004), radius=0.004),  # which touches both faces
              {"shape": "box", "size": [0.002, 0.002, 0.002], "path": [[0.03, 0.01, 0.004]]},
              {"shape": "capsule", "radius": 0.001, "length": 0.01, "axis": [1.0, 0.0, 0.0], "path": [[0.03, 0.01, 0.004]]}]
    for obstacle in within:
        with pytest.raises(InputError, match=r"^obstacle\.path: the obstacle starts wholly inside the body; start it outside$"):
            balance(body=fine, obstacle=obstacle)
    plate = {"shape": "plate", "length": 0.06, "width": 0.02, "cells": [6, 4], "cell": "triangle"}
    with pytest.raises(InputError, match=r"^obstacle\[1\]\.path: the obstacle starts wholly inside the body"):
        balance(body=plate, obstacle=[ball((0.03, 0.04, 0.0)), ball((0.03, 0.01, 0.0), radius=0.005)])
    scene = beam(body=BODY | {"cells": [6, 5, 3]}, support=SUPPORT, obstacle=ball((0.03, 0.01, 0.004), radius=0.0019))
    block = build_mesh(scene.body)
    middle = abs(block.points[block.cells].mean(axis=1) - [0.03, 0.01, 0.004])
    hollow = replace(block, cells=block.cells[(middle > [0.011, 1e-3, 1e-3]).any(axis=1)])  # without two cells of 10 x 4 x 8/3 mm
    narrow = replace(scene, obstacle=replace(scene.obstacle, radius=0.001))
    assert len(hollow.cells) == 88 and Balance(narrow, hollow).clearance(0.0) > 0
    with pytest.raises(InputError, match="starts 0.000567 m inside"):
        Balance(scene, hollow)


def test_a_pressure_alone_loads_a_body_and_so_does_a_turn():
    box = {"length": 0.02, "width": 0.02, "height": 0.02, "cells": [2, 2, 2]}
    def loaded(**more):
        scene = beam(body=box, **more)
        return Balance(scene, build_mesh(scene.body)).loaded
    assert not loaded() and loaded(load=[{"where": "z-max", "pressure": 1.0, "follower": True}])
    assert loaded(support=[{"where": "x-min"}, {"where": "x-max", "axis": [1, 0, 0], "angle": 1.0}])
    assert loaded(load=[{"where": "z-max", "pressure": 1.0}]) and loaded(load=[{"acceleration": [0, 0, 1.0]}])


def test_what_does_not_grow_evenly_is_varied_loads_and_supports_alike():
    push = {"where": "x-max", "traction": [0.0, 0.0, 1.0]}
    table = {"steps": [0.0, 0.5, 1.0], "factor": [0.0, 1.0, 0.5]}
    turn = {"where": "x-max", "axis": [1, 0, 0], "angle": 1.0}
    assert balance(load=[push]).varied is False and balance(load=[push | table]).varied is True
    assert balance(support=[SUPPORT[0], turn]).varied is True
    assert balance(load=[push]).target.tolist() == np.zeros((len(balance().mesh.points), 3)).tolist()
    moved = balance(support=[SUPPORT[0] | {"displacement": [0.0, 0.001, 0.0]}])
    assert moved.target[moved.mesh.points[:, 0] < 1e-9].tolist() == [[0.0, 0.001, 0.0]] * int((moved.mesh.points[:, 0] < 1e-9).sum())
    assert not moved.target[moved.mesh.points[:, 0] > 1e-9].any() and moved.varied is False


def test_what_is_told_of_each_obstacle_is_nothing_of_one_and_zero_forces_of_two_at_rest():
    rest = State(0.0, np.zeros((4, 3)), np.zeros(5))
    assert rest.of_each(1) == rest.of_each(0) == {}
    assert rest.of_each(2)["reactions"].tolist() == [[0, 0, 0]] * 2
    pressed = State(0.5, np.zeros((4, 3)), np.zeros(5), reactions=np.array([[1.0, 2, 3], [4, 5, 6]]))
    assert pressed.of_each(2)["reactions"].tolist() == [[1, 2, 3], [4, 5, 6]]


def slab(cells, held, **changes):
    """A slice 20 mm thick along y with so many cells across it, held in some directions everywhere on both of its faces."""
    faces = [{"where": f"y-{end}", "fixed": held} for end in ("min", "max")]
    return beam(**{"body": {"length": 0.06, "width": 0.02, "height": 0.01, "cells": [3, cells, 2], "cell": "hexahedron"},
                   "support": [{"where": "x-min"}, *faces], "load": [{"where": "x-max", "traction": [0.0, 0.0, 1.0]}]} | changes)


@pytest.mark.parametrize("cells, held, moved, said", [(1, "y", 0.0, True), (2, "y", 0.0, False), (1, "z", 0.0, False),
                                                      (1, "y", 1e-4, False)])
def test_a_slice_one_cell_thick_and_held_across_could_be_plane(cells, held, moved, said):
    scene = slab(cells, held)
    scene = replace(scene, support=tuple(replace(support, displacement=(0.0, moved, 0.0)) for support in scene.support))
    told = could_be_plane(Balance(scene, build_mesh(scene.body)))
    assert bool(told) == said
    if said:
        assert "one cell thick along y" in told["plane"] and 'plane = "strain", thickness = 0.02' in told["plane"]

"""How much too stiff cells of first order are for a mode is said: held against second-order hexahedra and plate theory."""

import pytest

from physics.modes.elastic import elastic_modes
from physics.modes.locking import too_high, too_stiff
from physics.scene import read_scene
from physics.solution import solve


def scene(cells, *, cell="hexahedron", length=0.4, order=1, **more):
    return read_scene({"body": {"length": length, "width": 0.02, "height": 0.02, "cells": cells, "cell": cell, "order": order} | more,
                       "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "support": [{"where": "x-min"}]})


@pytest.mark.parametrize("cell", ["hexahedron", "prism", "tetrahedron"])
@pytest.mark.parametrize("cells, length", [([40, 5, 5], 2.0), ([40, 5, 5], 0.4), ([20, 4, 4], 0.1)])
def test_the_excess_is_that_over_second_order(cell, cells, length):
    """Long cells, half as long as the beam is thick, and short ones: 0.02 to 1.7 too high."""
    given = scene(cells, cell=cell, length=length)
    modes = elastic_modes(given, count=1)
    true = elastic_modes(scene([40, 2, 2], length=length, order=2), count=1).frequencies_hz[0]
    excess = modes.frequencies_hz[0] / true - 1
    assert too_high(modes.mesh, modes.shapes[0], given.material) == pytest.approx(excess, rel=0.2)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_the_excess_in_the_plane(cell, plane):
    """A strip with cells as long as it is high, and an eighth of that."""
    for cells, length in (([20, 2], 0.4), ([80, 4], 0.2)):
        given, fine = (read_scene({"body": {"shape": "plate", "length": length, "width": 0.02, "cells": divisions, "cell": kind,
                                            "plane": plane, "order": order}, "support": [{"where": "x-min"}],
                                   "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}})
                       for divisions, kind, order in ((cells, cell, 1), ([40, 2], "quadrilateral", 2)))
        modes, true = elastic_modes(given, count=1), elastic_modes(fine, count=1).frequencies_hz[0]
        excess = modes.frequencies_hz[0] / true - 1
        assert too_high(modes.mesh, modes.shapes[0], given.material) == pytest.approx(excess, rel=0.25, abs=4e-3)


def told(given, **how):
    return [text for text in elastic_modes(given, **how).remarks if "too stiffly" in text]


def test_a_thin_plate_of_thick_cells_is_told_and_what_helps():
    """8.727 Hz by plate theory, 25.70 Hz with these cells."""
    plate = read_scene({"body": {"shape": "plate", "length": 1.0, "width": 1.0, "height": 0.01, "cells": [20, 20, 1]},
                        "material": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}, "support": [{"where": "x-min"}]})
    assert elastic_modes(plate, count=1).frequencies_hz[0] == pytest.approx(25.70, rel=1e-3)
    text, = told(plate, count=2)
    assert "mode 1 is too high by about 17" in text and "hexahedra of order 2" in text  # 172 or 173 %: it is multiple


def test_nothing_is_said_of_fine_cells_of_order_2_and_of_reduced_prisms():
    assert told(scene([10, 1, 1], length=0.2), count=1) and not told(scene([80, 8, 8], length=0.2), count=1)
    assert not told(scene([10, 1, 1], length=0.2, order=2), count=1)
    assert told(scene([10, 1, 1], length=0.2, cell="prism"), count=1)
    assert not told(scene([10, 1, 1], length=0.2, cell="prism", element="reduced"), count=1)


def test_rigid_modes_are_passed_over():
    free = read_scene({"body": {"length": 0.2, "width": 0.02, "height": 0.02, "cells": [10, 1, 1], "cell": "hexahedron"},
                       "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}})
    assert not told(free, count=6) and "mode 7 is" in told(free, count=7)[0]


def bent(cells, cell, load, *, nu=0.3, element="standard", turned=0.0, length=0.4):
    """A cantilever under a load across it at its end [Pa], about its middle plane or turned out of it by a moving support."""
    return read_scene({"body": {"length": length, "width": 0.02, "height": 0.02, "cells": cells, "cell": cell, "element": element},
                       "material": {"young_modulus": 1e6, "poisson_ratio": nu}, "steps": {"count": 2},
                       "support": [{"where": "x-min"} | ({"axis": [0, 1, 0], "angle": turned} if turned else {})],
                       "load": [{"where": "x-max", "traction": [0, 0, load]}]})


@pytest.mark.parametrize("cell, cells, nu, element, load, share", [
    ("hexahedron", [40, 5, 5], 0.3, "standard", -0.3, 0.15), ("prism", [20, 3, 3], 0.3, "standard", -30, 0.15),
    ("tetrahedron", [40, 5, 5], 0.3, "standard", -30, 0.15), ("hexahedron", [20, 3, 3], 0.499, "mean-dilatation", -30, 0.4)])
def test_what_a_bent_beam_is_too_stiff_is_its_deflection_against_cells_that_do_not_lock(cell, cells, nu, element, load, share):
    """Small and large, by up to a fifth of the length; with mean dilatation the estimate is the coarser one."""
    solution = solve(bent(cells, cell, load, nu=nu, element=element))
    true = solve(bent([60, 4, 4], "prism", load, nu=nu, element="reduced"))
    down = [abs(found.displacement[-1][:, 2]).max() for found in (solution, true)]
    excess = down[1] / down[0] - 1
    assert excess > 0.09
    material = bent(cells, cell, load, nu=nu).material
    found = too_stiff(solution.mesh, solution.displacement[-1], material, element, finite=solution.linear_steps == 0)
    assert found == pytest.approx(excess, rel=share)


def test_a_path_is_told_of_where_its_cells_are_too_stiff_and_what_helps():
    given = bent([10, 1, 1], "prism", -30)
    text, = solve(given).stiff(given)
    assert "at step 2 the body by about" in text and 'body.element = "reduced"' in text
    given = bent([10, 1, 1], "prism", -30, turned=40.0)  # by small strain 1 - cos 40 = 0.23 in every cell, which does not jump
    assert len(solve(given).stiff(given)) == 1
    for cells, cell, element in (([10, 1, 1], "prism", "reduced"), ([80, 8, 8], "hexahedron", "standard")):
        given = bent(cells, cell, -30, element=element)
        assert solve(given).stiff(given) == ()


def test_nothing_is_said_of_a_body_that_flies_unstrained():
    """What the solver leaves of strain in flight jumps from cell to cell."""
    given = read_scene({"body": {"length": 0.2, "width": 0.02, "height": 0.02, "cells": [10, 1, 1], "cell": "hexahedron"},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.3},
                        "steps": {"count": 4, "dynamic": True, "duration": 0.1, "velocity": [0.0, 0.0, 1.0]}})
    assert solve(given).stiff(given) == ()

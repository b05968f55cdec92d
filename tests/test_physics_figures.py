"""What is said of figures: units beside their factors, means and extremes over paths, and the sentence that sums them up, on paper."""

import math

import pytest

from physics.fidelity.figures import (
    ERROR,
    EXTREMES,
    FIGURES,
    FLOW,
    MESH,
    PHYSICS,
    PUBLISHED,
    field_columns,
    gathered,
    of_field,
    shown,
    verdict,
)
from physics.fidelity.verify import Fidelity

TIMES = {("mm", "m"): 1e3, ("mm²", "m2"): 1e6, ("", "1"): 1, **{(unit, unit): 1 for unit in ("m/s", "Pa", "1/s")}}  # of the first
EVERY = FIGURES | FLOW | field_columns(map(of_field, ("stress", "pressure", "velocity", "heat")))


@pytest.mark.parametrize("name", EVERY)
def test_a_figure_is_shown_in_its_unit(name):
    """As many of the first as are one of the second."""
    assert EVERY[name].factor == TIMES[EVERY[name].unit, EVERY[name].si] and EVERY[name].head and EVERY[name].meaning


def test_fields_have_the_units_that_are_known_of_them():
    assert [(EVERY[of_field(name)].unit, EVERY[of_field(name)].si) for name in ("stress", "pressure", "velocity", "heat")] == [
        ("Pa", "Pa"), ("Pa", "Pa"), ("m/s", "m/s"), ("", "1")]


def test_every_figure_is_one_of_verify_and_stands_in_one_group():
    known = {name for name in vars(Fidelity)["__dataclass_fields__"]}
    assert list(FIGURES) == [*ERROR, *PUBLISHED, *PHYSICS, *MESH]
    assert set(FIGURES) == known - {"rmsd_1_all_nodes", "rmsd_50_all_nodes", "worst_step"}
    lengths = {*PUBLISHED, "rmsd_1", "rmsd_50", "rmsd_all", "rmsd_all_all_nodes", "largest_penetration", "estimated_error", "gf_h"}
    assert {name for name in FIGURES if FIGURES[name].si == "m"} == lengths
    assert {name for name in FIGURES if FIGURES[name].si == "m2"} == {"gf_c"}


def test_over_several_paths_there_are_means_and_of_extremes_the_extreme():
    """Means of 1, 2, 6 are 3, of 1 and 6 alone 3.5; what no path has is not a number."""
    each = [dict.fromkeys(EXTREMES, value) | {"rmsd_all": value, "effectivity": value, "ar": math.nan} for value in (1.0, 2.0, 6.0)]
    each[1]["effectivity"] = math.nan
    found = gathered(each)
    assert (found["rmsd_all"], found["effectivity"]) == (3.0, 3.5) and math.isnan(found["ar"])
    assert {name: found[name] for name in EXTREMES} == {"largest_penetration": 6, "smallest_det_f": 1, "smallest_scaled_jacobian": 1,
                                                         "inverted_elements": 6, "flux_error": 6, "slip": 6}
    each[0]["smallest_det_f"] = math.nan
    assert gathered(each)["smallest_det_f"] == 2


def figures(error, **more):
    return {"rmsd_all": error, "relative_residual": 0.125, "largest_penetration": 0.0, "inverted_elements": 0} | more


@pytest.mark.parametrize("error, idle, words", [
    (2e-3, 8e-3, "Better than if nothing moved: 2 mm off, 4 times closer"), (0.0, 8e-3, "No different from the truth"),
    (1.6e-2, 8e-3, "No better than if nothing moved: 16 mm off, 2 times as far"),
    (8e-3, 8e-3, "No better than if nothing moved: 8 mm off, 1 times as far"),
    (3e-3, 0.0, "The truth does not move; the prediction is 3 mm off"), (0.0, 0.0, "The truth does not move; the prediction is 0 mm off")])
def test_an_error_is_told_beside_that_of_standing_still(error, idle, words):
    assert verdict(figures(error), figures(idle)) == (f"{words}; 12.5 % of the largest reaction is missing to equilibrium, "
                                                      "no cell is turned inside out.")


def test_obstacle_and_cells_are_spoken_of_where_there_is_something_to_say():
    still = figures(8e-3, largest_penetration=0.1)

    def told(**more):
        return verdict(figures(2e-3, relative_residual=math.nan, **more), still).partition("; ")[2]

    assert told() == "no cell is turned inside out." and told(inverted_elements=1) == "1 cell is turned inside out."
    assert told(inverted_elements=2) == "2 cells are turned inside out."
    assert told(inverted_elements=math.nan) == "" and verdict(figures(
        2e-3, relative_residual=math.nan, inverted_elements=math.nan), still) == "Better than if nothing moved: 2 mm off, 4 times closer."
    # From a hundredth of what the obstacle is in a body at rest.
    assert told(inverted_elements=math.nan, largest_penetration=0.00099) == ""
    assert told(inverted_elements=math.nan, largest_penetration=0.00101) == "the obstacle is up to 1.01 mm inside the body."


def test_three_digits_or_a_dash():
    assert [shown(value) for value in (math.nan, 0, 0.012345, 1234.5, -2.0)] == ["–", "0", "0.0123", "1.23e+03", "-2"]

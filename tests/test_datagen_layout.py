"""What the arrays and attributes of a trajectory have to be, one wrong at a time; and arrays of displacements."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from datagen.files.layout import EXTRA, displacements, exact, is_remainder, misshapen, precision, remainder_of
from physics.schema import InputError

T, N = 3, 5


def made(**changes):
    """Five nodes in three frames, one hexahedron's kind and one triangle's, two modes; `extra` is added to what is there."""
    parts = {"displacement": np.zeros((T, N, 3), np.float32), "points": np.zeros((N, 3)), "node_kind": np.zeros(N, np.uint8),
             "connectivity": np.arange(7), "offsets": np.arange(2), "types": np.array([12, 5], np.uint8),
             "modes": np.zeros((2, N, 3), np.float32), "segment": None, "body": np.array([True] + [False] * (N - 1)),
             "remainder": None, "per_frame": {"drag": np.zeros(T), "gap": np.zeros((T, 2)), "count": np.zeros(T, np.int64)},
             "fields": {"stress": np.zeros((T, N, 6))}, "frequencies_hz": (1.0, 2.0), "extra": {}}
    return SimpleNamespace(**parts | changes)


def test_what_fits_is_not_complained_of():
    assert misshapen(made()) == ""
    assert misshapen(made(frequencies_hz=(), segment=np.zeros(N, np.int32), per_frame={}, fields={})) == ""
    assert misshapen(made(modes=np.zeros((0, N, 3)), frequencies_hz=())) == ""
    assert misshapen(made(extra={name: kind() for name, kind in EXTRA.items()})) == ""
    assert misshapen(made(extra={"seconds": 2, "tolerance": 1e-6, "linear_steps": 7, "other": object()})) == ""


@pytest.mark.parametrize("changes, said", [
    ({"displacement": np.zeros((T, N))}, "displacement is not an array of frames"),
    ({"displacement": np.zeros((0, N, 3))}, "displacement is not an array of frames"),
    ({"displacement": np.zeros((T, N, 2))}, "displacement is 3 x 5 x 2 of float64, not 3 x 5 x 3 numbers"),
    ({"displacement": np.zeros((T, N, 3), int)}, "displacement is 3 x 5 x 3 of int64, not 3 x 5 x 3 numbers"),
    ({"points": np.zeros((N + 1, 3))}, "points is 6 x 3 of float64, not 5 x 3 numbers"),
    ({"points": np.zeros((N, 2))}, "points is 5 x 2 of float64, not 5 x 3 numbers"),
    ({"points": np.zeros((N, 3), int)}, "points is 5 x 3 of int64, not 5 x 3 numbers"),
    ({"node_kind": np.zeros(N)}, "node_kind is 5 of float64, not 5 numbers"),
    ({"node_kind": np.zeros((N, 1), int)}, "node_kind is 5 x 1 of int64, not 5 numbers"),
    ({"connectivity": np.zeros((2, 2), int)}, "connectivity is 2 x 2 of int64, not any numbers"),
    ({"offsets": np.zeros(2)}, "offsets is 2 of float64, not any numbers"),
    ({"types": np.zeros(2)}, "types is 2 of float64, not any numbers"),
    ({"modes": np.zeros((2, N + 1, 3))}, "modes is 2 x 6 x 3 of float64, not any x 5 x 3 numbers"),
    ({"modes": np.zeros((2, N, 2))}, "modes is 2 x 5 x 2 of float64, not any x 5 x 3 numbers"),
    ({"segment": np.zeros(N + 1, int)}, "segment is 6 of int64, not 5 numbers"),
    ({"segment": np.zeros(N)}, "segment is 5 of float64, not 5 numbers"),
    ({"per_frame": {"drag": np.zeros(T + 1)}}, "drag is 4 of float64, not 3 numbers"),
    ({"per_frame": {"gap": np.zeros((T + 1, 2))}}, "gap is 4 x 2 of float64, not 3 x any numbers"),
    ({"per_frame": {"gap": np.zeros((T, 2, 2))}}, "gap is 3 x 2 x 2 of float64, not 3 x any numbers"),
    ({"per_frame": {"drag": np.zeros(())}}, "drag is one of float64, not 3 numbers"),
    ({"per_frame": {"drag": np.zeros(T, bool)}}, "drag is 3 of bool, not 3 numbers"),
    ({"fields": {"stress": np.zeros((T, N + 1, 6))}}, "stress is 3 x 6 x 6 of float64, not 3 x 5 x any numbers"),
    ({"fields": {"stress": np.zeros((T, N))}}, "stress is 3 x 5 of float64, not 3 x 5 x any numbers"),
    ({"fields": {"stress": np.zeros((T, N, 6), int)}}, "stress is 3 x 5 x 6 of int64, not 3 x 5 x any numbers"),
    ({"remainder": np.zeros((T, N + 1, 3))}, "remainder is 3 x 6 x 3 of float64, not 3 x 5 x 3 numbers"),
    ({"remainder": np.zeros((T, N, 3), int)}, "remainder is 3 x 5 x 3 of int64, not 3 x 5 x 3 numbers"),
    ({"types": np.zeros(0, int)}, "it has no cells, or cells of a kind that is not among"),
    ({"connectivity": np.zeros(0, int)}, "it has no cells, or cells of a kind that is not among"),
    ({"types": np.array([12, 99])}, "it has no cells, or cells of a kind that is not among"),
    ({"body": np.zeros(N, bool)}, "every node is of the obstacle, none of a body"),
    ({"frequencies_hz": (1.0,)}, "1 frequencies for 2 modes"),
    ({"frequencies_hz": (1.0, 2.0, 3.0)}, "3 frequencies for 2 modes"),
    ({"frequencies_hz": (1.0,), "modes": np.zeros((0, N, 3))}, "1 frequencies for 0 modes"),
    ({"extra": {"seconds": math.nan}}, "extra has seconds = 'nan'"),
    ({"extra": {"seconds": "long"}}, "extra has seconds = 'long'"),
    ({"extra": {"linear_steps": 1.5}}, "extra has linear_steps = '1.5'"),
    ({"extra": {"failure": 3}}, "extra has failure = '3'"),
    ({"extra": {"model": ["a" * 60]}}, "extra has model = \"['" + "a" * 38 + "\"")])
def test_each_thing_that_does_not_fit_is_said(changes, said):
    assert misshapen(made(**changes)).startswith(said)


@pytest.mark.parametrize("given, frames", [(np.zeros((T, N, 3)), T), (np.zeros((T, N, 3), int), None), (np.zeros((1, N, 3), np.uint8), 1),
                                           (np.zeros((T, N, 3), np.float32), None), (np.zeros((T, N, 3), object), T)])
def test_displacements_of_whole_numbers_too_are_an_array(given, frames):
    found = displacements(given, frames, N, "of the body")
    assert found.dtype == (float if given.dtype == object else given.dtype) and found.shape == given.shape


@pytest.mark.parametrize("given, frames, said", [
    (np.zeros((T, N, 3)), T + 1, r"^displacement has shape \(3, 5, 3\): must be \(4, 5, 3\), frames from the rest state on, of the body, "
                                 r"x y z$"),
    (np.zeros((T, N, 2)), None, r"must be \(T, 5, 3\), frames"), (np.zeros((T, N + 1, 3)), T, r"must be \(3, 5, 3\)"),
    (np.zeros((T, N)), None, "has shape"), (np.zeros((0, N, 3)), None, "has shape"), (np.zeros((T, N, 3, 1)), None, "has shape"),
    ([[1, 2], [3]], None, "^displacement is no array of numbers: "), ("words", None, "^displacement is no array of numbers: ")])
def test_other_arrays_are_refused_in_one_line(given, frames, said):
    with pytest.raises(InputError, match=said) as caught:
        displacements(given, frames, N, "of the body")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("error", [ValueError, TypeError, RuntimeError])
def test_what_cannot_be_made_an_array_is_said_in_the_first_line_of_why(error):
    class Odd:
        def __array__(self, *_, **__):
            raise error("not here\nnor there")

    with pytest.raises(InputError, match=r"^displacement is no array of numbers: not here$"):
        displacements(Odd(), None, N, "")


def test_a_remainder_gives_back_what_rounding_took_to_twelve_bits():
    """0.1 is 0x3dcccccd in single precision, which is 1.490116e-9 too large (IEEE 754); of that 12 bits are kept."""
    given = np.array([[[0.1, -0.1, 0.0], [1.0, 2**-130, 1 / 3]]])
    rounded, rest = given.astype(np.float32), remainder_of(given)
    assert rest.dtype == np.float32 and rest[0, 0, 0] == pytest.approx(-1.4901161193847656e-9, rel=2**-12)
    assert rest[0, 0, 1] == -rest[0, 0, 0] and rest[0, 0, 2] == rest[0, 1, 0] == rest[0, 1, 1] == 0
    assert not (rest.view(np.uint32) & 0xfff).any()
    draws = 0.02 * np.random.default_rng(0).standard_normal((2, 500, 3))
    rounded, rest = draws.astype(np.float32), remainder_of(draws)
    off = abs(exact(rounded, rest) - draws)
    assert (off <= precision(rounded, rest)).all() and off.max() < 2**-36 * abs(draws).max() and is_remainder(rest, rounded)
    assert off.max() > 2**-42 * abs(draws).max()  # as sharp as it says: a few bits more would show
    assert np.array_equal(exact(rounded, None), rounded.astype(np.float64))
    assert np.array_equal(precision(rounded, None), 2.0**-24 * abs(rounded.astype(np.float64)))


def test_what_rounding_cannot_have_taken_is_no_remainder():
    u = np.array([[[1.0, -3.0, 0.0]]], np.float32)  # units in the last place: 2^-23, 2^-22, the smallest number
    for rest, fits in (([2**-24, -(2**-23), 0], True), ([2**-24, 2**-22, 0], False), ([2.1 * 2**-24, 0, 0], False), ([0, 0, 1e-20], False),
                       ([np.nan, 0, 0], False)):
        assert is_remainder(np.array([[rest]], np.float32), u) is fits
    assert not is_remainder(np.zeros((1, 1, 3), np.float32), np.array([[[np.inf, 0, 0]]], np.float32))

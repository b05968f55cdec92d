"""Which poses of a path are foreseen from which others, in what order they are solved, and what lies between them: poses made up."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from physics.reduced.pose import PoseState, Press
from physics.reduced.quasistatic import ENOUGH, EXACT, ROUNDS, Estimator, Solved, _sum


def on_path(centres, overlaps, size=1.0):
    estimator = Estimator.__new__(Estimator)
    estimator.centres, estimator.overlaps, estimator.size = np.array(centres, float), np.array(overlaps, bool), size
    estimator._way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(estimator.centres, axis=0), axis=1))])
    estimator.mesh = SimpleNamespace(points=np.zeros((2, 3)))
    return estimator


def pose(q, centre=(0.0, 0, 0), pressure=(0.0,), beyond=0.0, local=0.0, left=0.0):
    return Solved(PoseState(np.array(centre, float), np.array([q], float), np.full((2, 3), local, float), np.array(pressure, float),
                            np.full(6, float(q))), np.array([beyond], float), np.full(6, left, float))


def test_a_sum_of_poses_has_shares_of_all_that_is_foreseen_and_nothing_pulls():
    found = _sum([3.0, -2.0], [pose(5, (1, 2, 3), (1.0, 4.0), 7, 0.5, 9), pose(1, (4, 4, 4), (5.0, 1.0), 2, 0.25, 8)])
    assert found.state.q == [13] and found.beyond == [17] and (found.state.local == 1.0).all()
    assert found.state.pressure.tolist() == [0, 10]  # 3 - 10 would pull
    assert found.state.centre.tolist() == [1, 2, 3] and (found.left == 9).all() and (found.state.push == 5).all()


def test_a_pose_is_foretold_by_the_polynomial_through_the_four_nearest():
    """Frames at unequal places on the way; a quartic, so that another four would give another value."""
    way = np.array([0.0, 1, 3, 4, 6, 9, 11, 12, 15, 16])
    estimator = on_path(way[:, None] * [0.6, 0, 0.8], np.ones(10))
    known = [0, 1, 3, 5, 7, 9]
    found = {frame: pose(way[frame] ** 4, estimator.centres[frame], beyond=way[frame] ** 3) for frame in known}
    # Two on either side, where there are two: of frame 2 no second one before 1 but 0.
    for frame, near in ((2, [0, 1, 3, 5]), (4, [1, 3, 5, 7]), (6, [3, 5, 7, 9]), (8, [3, 5, 7, 9])):
        guess = estimator._foretold(known, found, frame)
        literal = sum(way[a] ** 4 * np.prod([(way[frame] - way[b]) / (way[a] - way[b]) for b in near if b != a]) for a in near)
        assert guess.state.q == pytest.approx(literal, rel=1e-12) and guess.beyond == pytest.approx(way[frame] ** 3, rel=1e-12)
    few = estimator._foretold([1, 3, 5], found, 4)  # three have a parabola
    literal = sum(way[a] ** 4 * np.prod([(6 - way[b]) / (way[a] - way[b]) for b in (1, 3, 5) if b != a]) for a in (1, 3, 5))
    assert few.state.q == pytest.approx(literal, rel=1e-12)
    alone = estimator._foretold([1], found, 4)
    assert alone.state.q == [1]


def followed(monkeypatch, estimator, frames, answers):
    """What `_follow` finds and asks: (frame, q of the guess, q of the pose near it); answers: frame -> pose."""
    asked = []

    def solved(press, centre, guess, near):
        frame = int(np.flatnonzero((estimator.centres == centre).all(axis=1))[0])
        asked.append((frame, float(guess.state.q[0]), float(near.state.q[0])))
        return answers[frame]

    monkeypatch.setattr(estimator, "_solved", solved)

    def rest(centre):
        return PoseState(centre, np.zeros(1), np.zeros((2, 3)), np.zeros(1), np.zeros(6))

    press = SimpleNamespace(rest=rest, model=SimpleNamespace(space=np.zeros((6, 1))))
    return estimator._follow(press, np.array(frames)), asked


def test_each_pose_is_solved_from_the_last_two_and_none_where_nothing_touches(monkeypatch):
    """At heights 10, 9, 7, 6, 3, 4 and 8; from the rest at the last one before it overlaps. From 9 to 7 and on to 6: half as far again."""
    heights = [10, 9, 7, 6, 3, 4, 8]
    estimator = on_path([[0, 0, z] for z in heights], [0, 0, 1, 1, 1, 0, 0])
    answers = {frame: pose(q, estimator.centres[frame], [1.0]) for frame, q in ((2, 8.0), (3, 20.0), (4, 1.0), (5, -3.0))}
    found, asked = followed(monkeypatch, estimator, [2, 3, 4, 5, 6], answers | {6: pose(0.5, estimator.centres[6])})
    # 8 + 1/2 (8 - 0); 20 + 3 (20 - 8); back by a third: 1 - 1/3 (1 - 20); on by four: -3 + 4 (-3 - 1)
    assert asked == [(2, 0, 0), (3, 12, 8), (4, 56, 20), (5, pytest.approx(1 + 19 / 3), 1), (6, pytest.approx(-3 + 4 * -4), -3)]
    assert [found[frame].state.q[0] for frame in (2, 3, 4, 5)] == [8, 20, 1, -3]
    # The last one neither presses nor overlaps: at rest, whatever was found, and where it is.
    assert found[6].state.q == [0] and found[6].state.centre.tolist() == [0, 0, 8] and not found[6].left.any()


def test_after_it_has_let_go_it_begins_at_rest_again(monkeypatch):
    estimator = on_path([[0, 0, z] for z in (5, 4, 6, 7, 3, 2)], [0, 1, 0, 0, 1, 1])
    answers = {1: pose(8.0, estimator.centres[1], [1.0]), 2: pose(3.0, estimator.centres[2]), 4: pose(6.0, estimator.centres[4], [1.0]),
               5: pose(9.0, estimator.centres[5], [1.0])}
    found, asked = followed(monkeypatch, estimator, [0, 1, 2, 3, 4, 5], answers)
    assert [frame for frame, *_ in asked] == [1, 2, 4, 5]  # none at 0 and 3
    assert asked[2] == (4, 0, 0) and asked[3][1:] == (6 + 6 / 4, 6)
    assert [found[frame].state.q[0] for frame in range(6)] == [0, 8, 0, 0, 6, 9]
    pressed_at_once = on_path([[0, 0, 0], [0, 0, -1]], [1, 1])
    _, asked = followed(monkeypatch, pressed_at_once, [0, 1], {0: pose(2.0, (0, 0, 0), [1.0]), 1: pose(3.0, (0, 0, -1), [1.0])})
    assert asked == [(0, 0, 0), (1, 2, 2)]  # from two at one place nothing is foreseen


def test_the_clearance_along_a_path_is_that_of_all_points_in_each_frame():
    """Of a sphere of radius 0.3 that goes past a cloud, a fortieth of its width a step, so that other points are the nearest by and by."""
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    estimator = on_path(np.linspace([-2, 0.1, 0.2], [2, -0.1, 0.3], 80), np.ones(80), 0.2)
    estimator.obstacle = SimpleNamespace(gap=lambda x, centre: (np.linalg.norm(x - centre, axis=1) - 0.3, None))
    expected = [min(np.linalg.norm(point - centre) - 0.3 for point in points) for centre in estimator.centres]
    np.testing.assert_allclose(estimator._clearance(points), expected, rtol=1e-12)


@pytest.mark.parametrize(("cosine", "corner"), [(0.9901, False), (0.9899, True), (-1.0, True)])
def test_a_corner_is_where_two_steps_turn_by_more_than_the_cosine_says(cosine, corner):
    """Steps of 0.3 and 0.7 aslant to all axes; before the turn and behind it the way is straight."""
    one = np.array([1.0, 2, 2]) / 3
    other = cosine * one + np.sqrt(1 - cosine**2) * np.array([2, 1, -2]) / 3
    steps = [0.3 * one, 0.7 * one, 0.7 * other, 0.3 * other]
    estimator = on_path(np.concatenate([[[5, 6, 7]], [5, 6, 7] + np.cumsum(steps, axis=0)]), np.ones(5), size=100.0)
    assert [(part[0], part[-1]) for part in estimator._pieces(0)] == ([(0, 2), (2, 4)] if corner else [(0, 4)])
    assert [(part[0], part[-1]) for part in estimator._pieces(1)] == ([(1, 2), (2, 4)] if corner else [(1, 4)])


def solving(monkeypatch, forces, *, reached=True):
    """An estimator and a press whose internal forces come from a list, as often as asked; the space is one component of six."""
    estimator, asked = on_path([[0, 0, 0.0]], [1]), []
    forces = iter(forces)
    space = np.array([[1.0], [0], [0], [0], [0], [2.0]])

    def newton(centre, state, c):
        asked.append((round(float(state.q[0]), 12), float(c[0])))
        return None if not reached else PoseState(centre, state.q + 1, state.local, state.pressure, np.arange(6.0))

    def advance(centre, state, c):
        asked.append("from the pose near it")
        return PoseState(centre, state.q + 100, state.local, state.pressure, np.arange(6.0))

    elastic = SimpleNamespace(internal=lambda u: next(forces))
    press = SimpleNamespace(newton=newton, advance=advance, elastic=elastic, displacement=lambda state: np.full((2, 3), state.q[0]),
                            model=SimpleNamespace(space=space, slope=lambda q: 10 * q))
    return estimator, press, asked


def test_what_the_body_has_beyond_the_polynomial_is_put_right_until_it_no_longer_changes(monkeypatch):
    """c = Phi^T f - dW/dq of the state, then Newton again; at most six solutions, one where c is off by less than 1e-4 of a cell."""
    assert (ROUNDS, EXACT, ENOUGH) == (6, 1e-4, 1e-2)
    ones, guess = np.ones(6), pose(4.0, beyond=0.5)
    estimator, press, asked = solving(monkeypatch, [ones, 5 * ones, *[7 * ones] * 4])
    found = estimator._solved(press, np.zeros(3), guess, pose(1.0))
    # Phi^T f = 3 f; at q = 5 c = 3 - 50, off by -47.5 from 0.5; at 6: 15 - 60, off by 2 from -47; the line through both is off by
    # nothing at -47 + 2 (-47 - 0.5) / (-47.5 - 2) of what was taken, where it gives -45 - 2 (-45 + 47) / (2 + 47.5)
    assert asked[:3] == [(4, 0.5), (5, -47), (6, pytest.approx(-45 - 4 / 49.5))]
    assert len(asked) == 6 and found.state.q == [10] and found.beyond == [21 - 100]
    assert found.left == pytest.approx(np.arange(6.0) - 7)  # push - force
    for off, solved in ((0.9e-4, 1), (1.1e-4, 2)):  # 2 (c - known) is the largest change in displacements
        estimator, press, asked = solving(monkeypatch, [ones * (50.5 + off / 2) / 3, *[ones * 20] * 5])
        found = estimator._solved(press, np.zeros(3), guess, pose(1.0))
        assert len(asked) == (6 if solved > 1 else 1) and asked[0] == (4, 0.5)
    small, press, asked = solving(monkeypatch, [ones * 50.5 / 3 + 0.9e-4 / 6, *[ones] * 5])
    press.displacement = lambda state: np.full((2, 3), 0.5)  # of a displacement smaller than a cell
    small._solved(press, np.zeros(3), guess, pose(1.0))
    assert len(asked) == 6


def test_where_newton_does_not_lead_to_a_pose_it_is_reached_from_the_one_near_it(monkeypatch):
    estimator, press, asked = solving(monkeypatch, [np.ones(6)], reached=False)
    found = estimator._solved(press, np.ones(3), pose(4.0, beyond=0.5), pose(1.0))
    # that c cannot be put right from there is told by what is left over
    assert asked[:2] == [(4, 0.5), "from the pose near it"] and len(asked) == 3 and found.state.q == [101]
    assert found.left == pytest.approx(np.arange(6.0) - 1)
    estimator, press, asked = solving(monkeypatch, [np.full(6, np.nan)])
    assert estimator._solved(press, np.ones(3), pose(4.0, beyond=0.5), pose(1.0)) is None  # a cell is inside out
    estimator, press, asked = solving(monkeypatch, [], reached=False)
    press.advance = lambda centre, state, c: None
    assert estimator._solved(press, np.ones(3), pose(4.0, beyond=0.5), pose(1.0)) is None


def test_a_pose_without_a_state_is_left_out_and_the_next_is_solved_from_those_before(monkeypatch):
    estimator = on_path([[0, 0, z] for z in (5, 4, 3, 2, 1)], [0, 1, 1, 1, 1])
    answers = {1: pose(8.0, estimator.centres[1], [1.0]), 2: pose(9.0, estimator.centres[2], [1.0]), 3: None,
               4: pose(12.0, estimator.centres[4], [1.0])}
    found, asked = followed(monkeypatch, estimator, [0, 1, 2, 3, 4], answers)
    assert sorted(found) == [0, 1, 2, 4] and asked[2:] == [(3, 10, 9), (4, 11, 9)]


def test_a_way_is_halved_until_newton_leads_on_and_given_up_where_short_ways_do_not():
    """A Newton's method made up that goes no farther than `reach`, and not past 10; cells of size one."""
    press, tried = Press.__new__(Press), []
    press.size = 1.0

    def newton(centre, state, c):
        tried.append(centre[0] - state.centre[0])
        return replace(state, centre=centre) if tried[-1] <= c[0] and centre[0] < 10 else None

    press.newton = newton
    for reach, end, longest in ((1.0, 9.0, 1.0), (0.3, 9.0, 0.3), (0.08, 9.0, 0.08), (0.01, 1.0, None), (1.0, 20.0, None)):
        tried.clear()
        found = press.advance(np.array([end, 0, 0]), pose(1.0).state, np.array([reach]))
        assert max(tried) <= 1  # farther than a cell is not even tried
        if longest is None:
            assert found is None and (end > 1 or tried == [1, 1 / 2, 1 / 4, 1 / 8, 1 / 16])
        else:
            assert found.centre[0] == end and min(tried) > longest / 2


def test_frames_at_poses_are_these_and_others_lie_on_the_part_that_they_belong_to():
    estimator = on_path(np.arange(9)[:, None] * [0, 0, 0.5], np.ones(9))

    class Part:
        def __init__(self, x, value):
            self.x, self.value = np.array(x), value

        def __call__(self, way):
            return np.full((2, 2, 3), self.value + way) * [[[1.0]], [[2.0]]]

    estimator._parts, estimator._known = [Part([1.0, 2.0], 10), Part([2.0, 3.0], 20)], {5: np.ones((2, 2, 3)) * [[[7.0]], [[8.0]]]}
    found, answer = estimator.frames([0, 1, 2, 3, 4, 5, 6, 7, 8])
    # Before the first part nothing has moved; on the way 1.0, 1.5 | 2.0, known, 3.0; and then it stays as at the end.
    assert found[:, 0, 0].tolist() == [0, 0, 11, 11.5, 22, 7, 23, 23, 23] and (answer[[2, 3, 4, 5], 1, 2] == [22, 23, 44, 8]).all()
    assert found.dtype == answer.dtype == np.float32 and found.shape == (9, 2, 3)

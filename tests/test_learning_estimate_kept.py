"""Estimates that are kept: which file is read again, for what it is good, and where its numbers go."""

from dataclasses import replace

import numpy as np
import pytest

from learning.samples import estimate as module
from learning.samples.estimate import Estimate, estimate
from physics.schema import InputError
from tests.synthetic import bending


class Counted:
    """An estimator made up: at frame f every body node has gone f, and the answer is -f; it counts how often it is made."""

    made = 0
    lost = (5, 8)

    def __init__(self, trajectory):
        type(self).made += 1
        self.nodes = int(trajectory.body.sum())

    def frames(self, frames):
        assert isinstance(frames, list) and all(isinstance(frame, int) for frame in frames)
        u = np.array(frames, np.float32)[:, None, None] * np.ones((1, self.nodes, 3), np.float32)
        return u, -u


@pytest.fixture
def counted(monkeypatch):
    monkeypatch.setattr(module, "estimator_of", Counted)
    Counted.made = 0
    return Counted


@pytest.fixture
def trajectory():
    found = bending(cells=(4, 2, 2), steps=6)
    order = np.roll(np.arange(len(found.points)), 5)  # obstacle nodes among the first
    return replace(found, node_kind=found.node_kind[order], displacement=found.displacement[:, order])


FRAMES = np.array([2, 3, 6])


def test_the_body_has_the_estimate_and_the_rest_what_is_given(counted, trajectory, tmp_path):
    before = trajectory.displacement.copy()
    found = estimate(trajectory, FRAMES)
    body = trajectory.body
    for row, frame in enumerate(FRAMES):
        assert (found.displacement[row, body] == frame).all() and (found.answer[row, body] == -frame).all()
    np.testing.assert_array_equal(found.displacement[:, ~body], before[FRAMES][:, ~body])
    assert not found.answer[:, ~body].any()
    np.testing.assert_array_equal(trajectory.displacement, before)  # which is left as it was
    assert found.displacement.dtype == found.answer.dtype == np.float32
    assert list(tmp_path.iterdir()) == [] and counted.made == 1


def test_what_is_kept_is_read_again_and_believed(counted, trajectory, tmp_path):
    first = estimate(trajectory, FRAMES, cache=tmp_path)
    file, = tmp_path.iterdir()
    assert file.suffix == ".npz" and len(file.stem) == 32
    kept = np.load(file)["found"]
    np.testing.assert_array_equal(kept, [first.displacement[:, trajectory.body], first.answer[:, trajectory.body]])
    again = estimate(trajectory, FRAMES, cache=tmp_path)
    assert counted.made == 1
    np.testing.assert_array_equal(again.displacement, first.displacement)
    np.testing.assert_array_equal(again.answer, first.answer)
    assert again.lost == first.lost == (5, 8)
    np.savez(file, found=kept + 100, lost=[])
    again = estimate(trajectory, FRAMES, cache=tmp_path)
    np.testing.assert_array_equal(again.answer[:, trajectory.body], first.answer[:, trajectory.body] + 100)
    assert again.lost == ()
    assert counted.made == 1 and [path.name for path in tmp_path.iterdir()] == [file.name]
    estimate(trajectory, FRAMES)  # without a folder nothing is looked up
    assert counted.made == 2


def test_anything_that_an_estimate_depends_on_makes_another(counted, trajectory, tmp_path, monkeypatch):
    def made(of, frames=FRAMES):
        before = counted.made
        estimate(of, frames, cache=tmp_path)
        return counted.made - before

    assert made(trajectory) == 1 and made(trajectory) == 0
    rigid, moved, free = ~trajectory.body, trajectory.displacement.copy(), trajectory.displacement.copy()
    moved[3, rigid] += 1e-4
    free[:, trajectory.free] += 1.0
    kind = trajectory.node_kind.copy()
    kind[np.flatnonzero(trajectory.free)[0]] = 3
    for other in (dict(points=trajectory.points * 1.01), dict(scene="name = 'b'"), dict(displacement=moved), dict(node_kind=kind),
                  dict(connectivity=trajectory.connectivity[::-1].copy())):
        assert made(replace(trajectory, **other)) == 1, other
    assert made(trajectory, np.array([2, 3, 5])) == 1
    assert made(replace(trajectory, displacement=free)) == 0  # free nodes are never read
    monkeypatch.setattr(module, "VERSION", module.VERSION + 1)
    assert made(trajectory) == 1


def test_an_estimate_is_found_by_its_frame():
    found = Estimate(FRAMES, np.arange(18.0, dtype=np.float32).reshape(3, 2, 3), -np.arange(18.0, dtype=np.float32).reshape(3, 2, 3))
    for row, frame in enumerate(FRAMES.tolist()):
        u, answer = found.at(frame)
        np.testing.assert_array_equal(u, found.displacement[row])
        np.testing.assert_array_equal(answer, found.answer[row])
    for frame in (0, 1, 4, 5, 7, 100):
        with pytest.raises(KeyError, match=f"no estimate of frame {frame}"):
            found.at(frame)


def test_a_trajectory_without_a_scene_is_refused_and_leaves_nothing(trajectory, tmp_path):
    with pytest.raises(InputError, match="holds no scene"):
        estimate(trajectory, FRAMES, cache=tmp_path)
    assert list(tmp_path.iterdir()) == []

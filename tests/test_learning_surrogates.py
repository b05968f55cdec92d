"""A network as a predictor: which path, what it costs and when, with rollouts, correctors and clocks that are made up."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from learning.config import TrainConfig
from learning.networks.rivals.mgn import MGNConfig
from learning.prediction import surrogates as module
from learning.prediction.predictor import Case, LeftOut
from learning.prediction.surrogates import corrected, corrected_rollout, estimated, learned
from physics.equilibrium.state import NoEquilibrium
from physics.schema import InputError
from tests.synthetic import bending

MODEL = SimpleNamespace(config=TrainConfig())


@pytest.fixture(scope="module")
def case():
    return Case("a", bending(cells=(4, 2, 2), steps=4), "scene", "mesh")


class World:
    """Processor time runs at half of the wall's. A rollout takes 20 s of processor time for the set-up and 4 steps of 5 s."""

    def __init__(self, patch, case):
        self.now, self.modes, self.fails, self.shares = 100.0, [], None, []
        self.path = np.random.default_rng(0).normal(size=case.trajectory.displacement.shape).astype(np.float32)
        patch.setattr(module, "time", SimpleNamespace(process_time=lambda: self.now, perf_counter=lambda: 2 * self.now + 7))
        patch.setattr(module, "rollout", self.rollout)
        patch.setattr(module, "predict_step", self.steps)
        patch.setattr(module, "elastic_modes", self.elastic)
        patch.setattr(module, "Corrector", self.corrector)

    def rollout(self, model, trajectory, *, correct=None, share=0.0):
        self.shares.append(share)
        if self.fails is not None:
            raise self.fails
        self.now += 40
        path = self.path.copy()
        if correct is not None:
            for frame in range(1, len(path)):
                path[frame, trajectory.body] = correct(path[frame, trajectory.body], frame)
        return replace(trajectory, displacement=path, extra={"seconds_per_step": 10.0})  # of wall time

    def steps(self, model, trajectory):
        self.now += 1000  # which do not count
        return self.path[1:] + 1

    def elastic(self, scene, *, count, mesh):
        self.now += 3
        self.modes.append((scene, count, mesh))

    def corrector(self, scene, mesh, *, count):
        self.now += 30
        world = self

        def correct(u, fraction):
            world.asked.append((count, fraction))
            if world.lost == len(world.asked):
                raise NoEquilibrium("too far")
            correct.iterations += 2
            return u + 0.25 * fraction
        correct.iterations, correct.share = 0, 0.25
        self.asked, self.about = [], (scene, mesh)
        return correct

    lost = None


@pytest.fixture
def world(monkeypatch, case):
    return World(monkeypatch, case)


def test_a_networks_own_rollout_and_its_single_steps(world, case):
    predictor = learned(MODEL)
    assert (predictor.name, predictor.kind) == ("M4GN", "learned") and learned(MODEL, "b").name == "b"
    found = predictor.predict(case)
    body = case.trajectory.body
    np.testing.assert_array_equal(found.path, world.path[:, body])
    np.testing.assert_array_equal(found.one_step, world.path[1:, body] + 1)
    # of 40 s of processor and 80 s of wall time, 4 steps of 10 s of wall are a half; 3 s for the mode
    assert (found.seconds, found.set_up, found.iterations) == (20.0, 23.0, None)
    assert world.modes == [("scene", 1, "mesh")]
    assert learned(MODEL, single_steps=False).predict(case).one_step is None


def test_steps_never_take_more_than_the_whole(world, case, monkeypatch):
    monkeypatch.setattr(world, "rollout", None)
    monkeypatch.setattr(module, "rollout", lambda model, trajectory: (
        setattr(world, "now", world.now + 10), replace(trajectory, extra={"seconds_per_step": 10.0}))[1])
    found = learned(MODEL, single_steps=False).predict(case)  # 4 steps of 10 s within 20 s, says the clock
    assert (found.seconds, found.set_up) == (10.0, 3.0)


@pytest.mark.parametrize("config, modes", [({}, 1), ({"method": "slic-md"}, 1), ({"method": "slic-od-e"}, 0), ({"method": "metis"}, 0),
                                           ({"modes": "laplacian"}, 0), ({"method": "metis", "modes": "laplacian"}, 0)])
def test_a_mode_is_paid_for_where_the_segments_need_one(world, case, config, modes):
    found = learned(SimpleNamespace(config=TrainConfig(**config))).predict(case)
    assert len(world.modes) == modes and found.set_up == 20.0 + 3 * modes


@pytest.mark.parametrize("count, name", [(1, "M4GN, corrected 10-fold"), (3, "M4GN, corrected 1000-fold"),
                                         (None, "M4GN, as the start of Newton")])
def test_a_corrected_rollout(world, case, count, name):
    predictor = corrected(MODEL, count)
    assert (predictor.name, predictor.kind) == (name, "hybrid")
    found = predictor.predict(case)
    fractions = np.array([0.25, 0.5, 0.75, 1.0])
    assert world.asked == [(count, fraction) for fraction in fractions] and world.about == ("scene", "mesh")
    body = case.trajectory.body
    np.testing.assert_allclose(found.path[1:], world.path[1:, body] + 0.25 * fractions[:, None, None], atol=1e-6)
    np.testing.assert_array_equal(found.path[0], world.path[0, body])
    # 70 s of processor time, 140 of wall, of which 40 are steps
    assert (found.seconds, found.set_up, found.iterations) == (pytest.approx(20), pytest.approx(50 + 3), 8)
    assert found.one_step is None and world.shares == [0.25]


def test_what_blows_up_or_is_lost_is_left_out(world, case):
    world.lost = 3
    with pytest.raises(LeftOut, match="led nowhere at frame 3: too far"):
        corrected_rollout(MODEL, case.trajectory, "scene", "mesh", 1)
    world.fails = FloatingPointError("at step 2")
    for predictor in (learned(MODEL), corrected(MODEL, 1)):
        with pytest.raises(LeftOut, match="it blows up: at step 2"):
            predictor.predict(case)


class Estimator:
    """An estimator that takes 6 s and has the world's path, and 2 more where it is rough."""

    def __init__(self, world, case):
        self.world, self.case, self.lost = world, case, []

    def __call__(self, trajectory, *, rough):
        self.world.now += 6
        assert not trajectory.displacement[:, trajectory.free].any()  # it is shown no truth
        held = ~trajectory.free
        np.testing.assert_array_equal(trajectory.displacement[:, held], self.case.trajectory.displacement[:, held])
        path = self.world.path[:, trajectory.body] + 2 * rough
        return SimpleNamespace(frames=lambda frames: (path[list(frames)], None), lost=self.lost)


def test_the_reduced_model_is_the_estimate_without_the_network(world, case, monkeypatch):
    monkeypatch.setattr(module, "estimator_of", Estimator(world, case))
    for rough in (False, True):
        predictor = estimated("by itself", rough=rough)
        assert (predictor.name, predictor.kind) == ("by itself", "reduced")
        found = predictor.predict(case)
        assert not found.path[0].any()
        np.testing.assert_array_equal(found.path[1:], world.path[1:, case.trajectory.body] + 2 * rough)
        assert (found.seconds, found.set_up, found.one_step) == (6.0, 0.0, None)


def test_where_the_reduced_model_loses_its_way_it_is_left_out(world, case, monkeypatch):
    estimator = Estimator(world, case)
    estimator.lost = [7, 9]
    monkeypatch.setattr(module, "estimator_of", estimator)
    with pytest.raises(LeftOut, match="no state at 2 of its poses, the first of them frame 7"):
        estimated("r").predict(case)


def test_what_the_reduced_model_does_not_know_is_left_out(case, monkeypatch):
    def refused(trajectory, *, rough):
        raise InputError("clamped bodies alone")

    monkeypatch.setattr(module, "estimator_of", refused)
    with pytest.raises(LeftOut, match="clamped bodies alone"):
        estimated("r").predict(case)


def test_a_predictor_of_all_frames_at_once_has_no_set_up_and_tells_how_sure_it_is(world, case, monkeypatch):
    class AtOnce:
        pass

    path = SimpleNamespace(displacement=world.path[:, case.trajectory.body], bar=np.arange(5.0), unsure=np.arange(5) > 3)
    given = []
    monkeypatch.setattr(module, "AtOnce", AtOnce)
    monkeypatch.setattr(module, "predict_path", lambda *them: given.append(them) or setattr(world, "now", world.now + 2) or path)
    model = AtOnce()
    found = learned(model, "sections").predict(case)
    assert given == [(model, "scene", "mesh")] and (found.seconds, found.set_up, world.modes) == (2.0, 0.0, [])
    np.testing.assert_array_equal(found.path, path.displacement)
    np.testing.assert_array_equal(found.one_step, world.path[1:, case.trajectory.body] + 1)
    assert found.bar is path.bar and found.unsure is path.unsure
    other = learned(model, "sections", single_steps=False)
    assert (other.name, other.kind) == ("sections", "learned") and other.predict(case).one_step is None
    assert corrected(model, 1).predict(case).set_up == pytest.approx(50) and not world.modes  # no mode is paid for

    def refuse(*them):
        raise InputError("no beam")
    monkeypatch.setattr(module, "predict_path", refuse)
    with pytest.raises(LeftOut, match="no beam"):
        learned(model).predict(case)


def test_without_a_scene_or_segments_no_mode_is_paid_for(world, case):
    assert learned(MODEL).predict(replace(case, known=None)).set_up == 20.0
    assert learned(SimpleNamespace(config=TrainConfig(network=MGNConfig()))).predict(case).set_up == 20.0 and not world.modes

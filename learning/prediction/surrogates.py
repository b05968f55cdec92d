"""A trained network as a predictor: alone, corrected by Newton steps, and as the start of the full Newton iteration.

Times are processor times. The set-up is what a new scene costs before its first step: the elastic mode that cuts the mesh into
segments, the segments, and for a corrected network the equations. Loading a checkpoint or a compiled form, done once, is not
part of it.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.trajectory import Trajectory
from learning.bodies.at_once import AtOnce
from learning.bodies.at_once import predict as predict_path
from learning.prediction.checkpoint import Model
from learning.prediction.predictor import Case, LeftOut, Prediction, Predictor
from learning.prediction.rollout import predict_step, rollout
from learning.samples.estimate import estimator_of
from physics.equilibrium.state import NoEquilibrium
from physics.fidelity.correct import Corrector
from physics.mesh.mesh import Mesh
from physics.modes.elastic import elastic_modes
from physics.scene import Scene
from physics.schema import InputError


def learned(model: Model | AtOnce, name: str = "M4GN", *, single_steps: bool = True) -> Predictor:
    """The network's own rollout, and with it single steps from true states, whose time does not count."""
    if isinstance(model, AtOnce):
        return _at_once(model, name, single_steps)

    def predict(case: Case) -> Prediction:
        modes = _modes_seconds(model, case)
        start, began = time.process_time(), time.perf_counter()
        try:
            predicted = rollout(model, case.trajectory)
        except FloatingPointError as error:
            raise LeftOut(f"it blows up: {error}") from None
        body = case.trajectory.body
        seconds, set_up = seconds_of(predicted, start, began)
        steps = predict_step(model, case.trajectory)[:, body] if single_steps else None
        return Prediction(path=predicted.displacement[:, body], one_step=steps, seconds=seconds, set_up=modes + set_up,
                          fields=predicted.fields)

    return Predictor(name, "learned", predict)


def _at_once(model: AtOnce, name: str, single_steps: bool) -> Predictor:
    """A predictor of all frames at once. It takes a scene and its mesh as the solver does, and nothing is set up before."""

    def predict(case: Case) -> Prediction:
        start = time.process_time()
        try:
            path = predict_path(model, case.scene, case.mesh)
        except InputError as error:
            raise LeftOut(str(error)) from None
        seconds = time.process_time() - start
        steps = predict_step(model, case.trajectory)[:, case.trajectory.body] if single_steps else None
        return Prediction(path=path.displacement, one_step=steps, seconds=seconds, bar=path.bar, unsure=path.unsure)

    return Predictor(name, "learned", predict)


def corrected(model: Model | AtOnce, count: int | None, name: str = "M4GN") -> Predictor:
    """Each predicted frame followed by Newton steps for `count` orders of magnitude of its error, or to the solver's tolerance (None);
    the rollout goes on from there."""

    def predict(case: Case) -> Prediction:
        modes = _modes_seconds(model, case)
        start, began = time.process_time(), time.perf_counter()
        predicted, corrector = corrected_rollout(model, case.trajectory, case.scene, case.mesh, count)
        seconds, set_up = seconds_of(predicted, start, began)
        return Prediction(path=predicted.displacement[:, case.trajectory.body], seconds=seconds, set_up=modes + set_up,
                          iterations=corrector.iterations, fields=predicted.fields)

    how = "as the start of Newton" if count is None else f"corrected {10**count}-fold"
    return Predictor(f"{name}, {how}", "hybrid", predict)


def estimated(name: str, *, rough: bool = False) -> Predictor:
    """The reduced-order model: what a network with estimate = true corrects, without the network; or a rough form of it, at few poses
    and in a smaller space. Nothing of it is learned."""

    def predict(case: Case) -> Prediction:
        start, path = time.process_time(), np.zeros_like(case.truth)
        given = np.where(case.trajectory.free[:, None], np.float32(0), case.trajectory.displacement)
        try:
            estimator = estimator_of(replace(case.trajectory, displacement=given, remainder=None), rough=rough)
        except InputError as error:
            raise LeftOut(f"{error}") from None
        if estimator.lost:
            raise LeftOut(f"it finds no state at {len(estimator.lost)} of its poses, the first of them frame {estimator.lost[0]}")
        path[1:] = estimator.frames(range(1, case.steps + 1))[0]
        return Prediction(path=path, seconds=time.process_time() - start)

    return Predictor(name, "reduced", predict)


def corrected_rollout(model: Model | AtOnce, trajectory: Trajectory, scene: Scene, mesh: Mesh,
                      count: int | None) -> tuple[Trajectory, Corrector]:
    """The rollout of which each frame is corrected before the next one is predicted, and the corrector.

    Raises:
        LeftOut: a Newton step led nowhere, or the network to positions that are not finite
        InputError: a mesh that cannot be segmented
    """
    corrector, steps = Corrector(scene, mesh, count=count), len(trajectory.displacement) - 1

    def correct(u: NDArray[np.float64], frame: int) -> NDArray[Any]:
        try:
            return corrector(u, frame / steps)
        except NoEquilibrium as error:
            raise LeftOut(f"a Newton step led nowhere at frame {frame}: {error}") from None

    try:
        return rollout(model, trajectory, correct=correct, share=corrector.share), corrector
    except FloatingPointError as error:
        raise LeftOut(f"it blows up: {error}") from None


def seconds_of(predicted: Trajectory, start: float, began: float) -> tuple[float, float]:
    """Processor seconds of the steps and of the set-up of a rollout that began at these processor and wall times.

    A rollout knows the wall time of its steps; their share of the whole is taken for both clocks.
    """
    whole, wall = time.process_time() - start, time.perf_counter() - began
    share = min(1.0, predicted.extra["seconds_per_step"] * (len(predicted.displacement) - 1) / wall)
    return share * whole, (1 - share) * whole


def _modes_seconds(model: Model | AtOnce, case: Case) -> float:
    """What the elastic mode costs that the segments need; the file brings it along, another scene would not."""
    if isinstance(model, AtOnce) or case.known is None or not model.config.network.wants.segments:
        return 0.0
    if "md" not in model.config.method or model.config.modes != "elastic":
        return 0.0
    start = time.process_time()
    elastic_modes(case.scene, count=1, mesh=case.mesh)
    return time.process_time() - start

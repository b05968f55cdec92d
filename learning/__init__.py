"""Learned simulators, trained on trajectories and held against the physics that made them.

A room imports what stands above it in this list, never below:

    segments/     how a mesh is cut, and how good the cut is
    graphs/       what a network sees of a frame
    networks/     what predicts
    devices       where networks run
    config, keys  what a training is asked for, and the list of its keys
    processes     several processes on one training
    samples/      a frame of a trajectory as input and target; noise and scales; the reduced-order estimate
    slender/      beams: theory, and a network for what it leaves over, all poses of a path at once
    bodies/       bodies of any shape: the shapes that they take, and a network for how much of each
    prediction/   a whole path from a predictor: a trained network, a hybrid, finite elements, or a trivial one
    training/     how weights are found; trainings stopped and resumed
    report/       what is measured of predictors, and how it is shown
    flows/        predictors of flows compared
    study/        many trainings that differ in one thing, and a table of them
    demo, verbs   `./run demo`, and the command line's verbs

It imports physics and datagen; nothing here loads dolfinx until finite elements are asked for. What a user calls is importable from here:
`from learning import load_config, train, load_model, rollout, evaluate`.
"""

from importlib import import_module
from typing import Any

_PUBLIC = {
    "Frames": "samples.frames", "M4GN": "networks.m4gn", "Model": "prediction.checkpoint", "TrainConfig": "config",
    "collate": "samples.frames", "compare": "report.compare", "evaluate": "report.evaluate",
    "gradient": "prediction.gradient", "load_config": "config", "load_model": "prediction.checkpoint", "rollout": "prediction.rollout",
    "segment": "segments.cut", "segment_quality": "segments.quality", "sweep": "prediction.sweep",
    "to_pyg": "samples.frames", "train": "training.kinds",
}
__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'learning' has no attribute {name!r}")
    return getattr(import_module(f"learning.{_PUBLIC[name]}"), name)

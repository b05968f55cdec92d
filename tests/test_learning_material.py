"""What a network is told of the material: numbers of the scene at every node, scaled over the training set, only where it is asked for."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from datagen.files.trajectory import write_trajectory
from learning.config import NetworkInputs
from learning.graphs.layout import Layout, layout_of
from learning.networks.kinds import build
from learning.prediction.checkpoint import load_model
from learning.prediction.rollout import rollout
from learning.samples.samples import build_example, describe, fit_normaliser, sample
from learning.samples.seen import outside, seen
from learning.training.train import train
from physics.scene import read_scene
from physics.schema import InputError, parse_toml
from tests.networks import SMALL, training
from tests.synthetic import bending
from tests.test_learning_layout import channel

PLAIN = training(SMALL["mgn"], batch_size=2, steps=2)
TOLD = replace(PLAIN, inputs=NetworkInputs(material=True))


def beam(law="neo-hookean-log", young=1e5, poisson=0.25, density=1e4, **more):
    material = {"law": law, "young_modulus": young, "poisson_ratio": poisson, "density": density} | more
    scene = read_scene({"body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [10, 2, 2]}, "material": material,
                        "support": [{"where": "x-min"}], "steps": {"count": 4}, "obstacle": {
                            "shape": "cylinder", "radius": 0.01, "path": [[0.07, 0.01, 0.031], [0.07, 0.01, 0.011]]}})
    return replace(bending(steps=4), scene=scene.to_toml())


def graph_of(trajectory, config):
    case = build_example(trajectory, config)
    u = case.states.astype(np.float64)
    return describe(case, 3, u[2], u[1], config).graph


def test_every_node_is_told_the_numbers_of_the_scene_behind_what_it_sees_anyway():
    plain, told = graph_of(beam(), PLAIN), graph_of(beam(), TOLD)
    assert torch.equal(told.node[:, :12], plain.node) and told.node.shape[1] == 19 == Layout(material=True).widths.node
    expected = torch.tensor([5.0, 0.25, 4.0, 0, 1, 0, 0])  # log10 of 1e5 Pa and 1e4 kg/m3, the second law
    assert (told.node[:, 12:] == expected).all()
    for name in ("mesh_edge", "contact_edge", "mesh_pair", "contact_pair", "place"):
        assert torch.equal(getattr(told, name), getattr(plain, name))


def test_each_number_is_scaled_over_the_training_set_and_one_that_all_share_becomes_zero():
    cases = [build_example(beam("linear", young, poisson), TOLD) for young, poisson in ((1e5, 0.2), (1e7, 0.4))]
    scales = fit_normaliser(cases, TOLD)
    assert torch.allclose(scales.node[:, 12:14], torch.tensor([[6.0, 0.3], [1.0, 0.1]]), atol=1e-6)
    generator = torch.Generator().manual_seed(0)
    for case, sign in zip(cases, (-1.0, 1.0), strict=True):
        seen_here = scales.graph(sample(case, 1, TOLD, generator)[0]).node[:, 12:]
        assert torch.allclose(seen_here, torch.tensor([sign, sign, 0, 0, 0, 0, 0]), atol=1e-5)  # density and law are the same


def test_without_it_scales_and_widths_are_those_of_before():
    plain = fit_normaliser([build_example(beam(), PLAIN)], PLAIN)
    told = fit_normaliser([build_example(beam(), TOLD)], TOLD)
    assert torch.allclose(told.node[:, :12], plain.node, atol=1e-8)  # sums of wider tables are taken in another order
    assert torch.equal(told.mesh_edge, plain.mesh_edge)
    assert plain.layout == Layout() and build(PLAIN.network, plain.layout.widths).encode_node.first.in_features == 12


def test_a_checkpoint_keeps_what_it_was_told_and_its_rollout_depends_on_it(tmp_path):
    for name, trajectory in {"a": beam(), "b": beam("linear", 1e7, 0.4)}.items():
        write_trajectory(tmp_path / f"{name}.vtkhdf", trajectory)
    files = [tmp_path / "a.vtkhdf", tmp_path / "b.vtkhdf"]
    train(TOLD, files, files[:1], tmp_path / "run")
    train(PLAIN, files, files[:1], tmp_path / "plain")
    model, plain = load_model(tmp_path / "run"), load_model(tmp_path / "plain")
    assert model.config.inputs.material and model.normaliser.layout.material and not plain.normaliser.layout.material
    one, other = beam(poisson=0.2), beam(poisson=0.45)
    assert not np.array_equal(rollout(model, one).displacement, rollout(model, other).displacement)
    assert np.array_equal(rollout(plain, one).displacement, rollout(plain, other).displacement)
    with pytest.raises(InputError, match="trained with another inputs"):
        train(replace(PLAIN, steps=4), files, [], tmp_path / "run", resume=True)
    with pytest.raises(InputError, match="the scene in the file tells the material"):
        rollout(model, bending(steps=4))


def test_a_material_outside_of_the_training_ranges_is_said():
    known = seen([beam(poisson=0.2), beam(poisson=0.4)])
    assert outside(beam(poisson=0.3), known) == {}
    assert outside(beam(poisson=0.45, density=2e4), known) == pytest.approx({"density [kg/m3]": 1.0, "Poisson's ratio": 0.25})


def test_a_body_whose_material_these_numbers_do_not_tell_is_refused():
    with pytest.raises(InputError, match="the scene in the file tells the material of a body, and there is none"):
        build_example(replace(beam(), scene=""), TOLD)
    other = '\n[[material]]\nyoung_modulus = 2e6\npoisson_ratio = 0.1\nwhere = { box = [[0.05, 0, 0], [0.1, 0.02, 0.02]] }\n'
    scene = beam().scene.replace("[material]", "[[material]]") + other
    assert len(read_scene(parse_toml(scene)).materials) == 2
    with pytest.raises(InputError, match="bodies of one isotropic material"):
        build_example(replace(beam(), scene=scene), TOLD)


def test_a_flow_has_no_material():
    with pytest.raises(InputError, match="inputs.material = true: is of bodies"):
        layout_of([channel()], material=True)

"""What a network is told of a body's material, where its config asks for it: the same at every node, obstacles included.

    log10 of Young's modulus [Pa], Poisson's ratio, log10 of the density [kg/m3], one-hot of the law

Moduli and densities differ by powers of ten, hence the logarithms. The normaliser scales each over the training set.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from datagen.files.trajectory import Trajectory
from physics.body.material import LAWS
from physics.scene import Scene, read_any
from physics.schema import InputError, parse_toml

FEATURES = 3 + len(LAWS)


def material_of(trajectory: Trajectory) -> NDArray[np.float32]:
    """(7,) the features of its material. Raises `InputError` for a file without a scene, and for a body of several materials or of an
    orthotropic one, which these numbers do not tell."""
    scene = read_any(parse_toml(trajectory.scene)) if trajectory.scene else None
    if not isinstance(scene, Scene):
        raise InputError("inputs.material = true: the scene in the file tells the material of a body, and there is none")
    if len(scene.materials) > 1 or scene.materials[0].orthotropic is not None:
        raise InputError("inputs.material = true: takes bodies of one isotropic material")
    (material,) = scene.materials
    return np.array([math.log10(material.young_modulus), material.poisson_ratio, math.log10(material.density),
                     *(float(material.law == law) for law in LAWS)], np.float32)

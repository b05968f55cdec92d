"""A quarter of a half-space pressed by a sphere, in few cells of second order, small at the contact and its rim: for Hertz's theory.

The cells are rings about the axis, with one block in its middle, and layers downward. Far sides move as under a point load (Boussinesq),
of which contact is one from afar; the sphere is so large that what it moves sideways does not matter. Lengths in radii of contact.
"""

from dataclasses import replace

import numpy as np

from physics.equilibrium.path import LoadPath
from physics.mesh.mesh import Mesh
from physics.mesh.second import second_order
from physics.scene import Support, read_scene

RINGS = np.array([0.6, 0.9, 1.0, 1.15, 1.5, 2.1, 3.2, 5.5, 10.0])
LAYERS = np.array([0.15, 0.4, 0.75, 1.2, 1.9, 3.0, 5.0, 10.0])
YOUNG, POISSON, SPHERE, NEAR = 1e6, 0.3, 400.0, 1e-9


def quarter():
    """The mesh of second order; its middles of arcs lie on the circles."""
    plane, rows, last = [*RINGS[0] * np.array([[0, 0], [1, 0], [0.65, 0.65], [0, 1]])], [(0, 1, 2, 3)], [1, 2, 3]
    for radius in RINGS[1:]:
        new = [len(plane) + i for i in range(3)]
        plane += [radius * np.array([np.cos(turn), np.sin(turn)]) for turn in (0, np.pi / 4, np.pi / 2)]
        rows += [(last[i], new[i], new[i + 1], last[i + 1]) for i in (0, 1)]
        last = new
    points = np.concatenate([np.column_stack([plane, np.full(len(plane), -depth)]) for depth in (*LAYERS[::-1], 0.0)])
    cells = np.concatenate([np.column_stack([np.array(rows) + k * len(plane), np.array(rows) + (k + 1) * len(plane)])
                            for k in range(len(LAYERS))])
    mesh = second_order(Mesh(points, cells, "hexahedron", {}))
    x = mesh.points
    half_way = abs(abs(np.arctan2(x[:, 1], x[:, 0]) - np.pi / 4) - np.pi / 8) < NEAR
    on_arcs = half_way & (np.hypot(x[:, 0], x[:, 1]) > RINGS[1] * np.cos(np.pi / 8) - NEAR)
    x = x * np.where(on_arcs, 1 / np.cos(np.pi / 8), 1.0)[:, None] ** [1, 1, 0]
    far = (x[:, 2] < NEAR - LAYERS[-1]) | (np.hypot(x[:, 0], x[:, 1]) > RINGS[-1] - NEAR)
    places = {"x": abs(x[:, 0]) < NEAR, "y": abs(x[:, 1]) < NEAR, "far": far}
    return replace(mesh, points=x, places={name: np.flatnonzero(there) for name, there in places.items()})


def point_load(force, x):
    """Displacements (n, 3) below a half-space's surface z = 0 under a force downward at its origin (Johnson, Contact Mechanics, 3.2)."""
    away, depth = np.linalg.norm(x, axis=1), -x[:, 2]
    aside = depth / away**3 - (1 - 2 * POISSON) / (away * (away + depth))
    down = depth**2 / away**3 + 2 * (1 - POISSON) / away
    return force * (1 + POISSON) / (2 * np.pi * YOUNG) * np.column_stack([aside * x[:, 0], aside * x[:, 1], -down])


def hertz(radius=1.0):
    """Nodes, force over that of Hertz, radius of contact over his, for the depth at which that radius is as given.

    The radius is found from the moment F a^2 = 5/2 sum p r^2.
    """
    mesh, depth = quarter(), radius**2 / SPHERE
    path = [[0.0, 0.0, SPHERE], [0.0, 0.0, SPHERE - depth]]
    scene = read_scene({
        "body": {"length": 1.0, "width": 1.0, "height": 1.0, "cells": [1, 1, 1], "cell": "hexahedron", "order": 2},
        "material": {"law": "linear", "young_modulus": YOUNG, "poisson_ratio": POISSON}, "steps": {"count": 1},
        "support": [{"where": "x-min"}], "obstacle": {"shape": "sphere", "radius": SPHERE, "path": path}})
    held = Support(where="x", fixed="x"), Support(where="y", fixed="y"), Support(where="far", fixed="xyz")
    path = LoadPath(replace(scene, support=held), mesh)
    exact = 4 / 3 * YOUNG / (1 - POISSON**2) * SPHERE**0.5 * depth**1.5
    far = mesh.places["far"]
    path.balance.target[far] = np.where(path.balance.fixed[far], point_load(exact, mesh.points[far]), 0.0)
    force = path.advance(1.0).pressure
    away = np.linalg.norm(path.balance.contact.surface.positions(mesh.points)[:, :2], axis=1)
    return len(mesh.points), 4 * force.sum() / exact, np.sqrt(2.5 * (force @ away**2) / force.sum()) / radius

"""A cantilever and predictions of it, as a page shows them."""

import numpy as np

from physics.mesh.build import build_mesh
from physics.scene import Body, Material
from physics.view.drawing import ObstacleSurface
from physics.view.exhibit import Exhibit, path_exhibit

MESH = build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=(10, 2, 3)))
RUBBER = Material(law="neo-hookean", young_modulus=1e6, poisson_ratio=0.3)
STEPS = 8
HARD = 'tri <b>"0</script>3"'  # a title that would break a careless page


def bent() -> np.ndarray:
    """(T, N, 3) a cantilever that goes down by 30 mm, and back by 4 mm with the square of that: two shapes."""
    moved, part = np.zeros((STEPS + 1, *MESH.points.shape)), np.linspace(0, 1, STEPS + 1)[:, None]
    moved[..., 2] = -0.03 * part * (MESH.points[:, 0] / 0.1) ** 2
    moved[..., 0] = -0.004 * part**2 * MESH.points[:, 0] / 0.1
    return moved


def wrong() -> np.ndarray:
    """Off by 0, 1, .. 7 and, in the last frame, by 4 mm along y, all nodes alike."""
    return bent() + 1e-3 * np.array([0, 1, 2, 3, 4, 5, 6, 7, 4])[:, None, None] * [0.0, 1.0, 0.0]


def exhibits() -> list[Exhibit]:
    paths = {"guess": wrong(), "nothing": 0 * bent(), "blown up": np.inf * np.ones_like(bent()), "fe": bent()}
    worst = {"guess": wrong()[7:8], "fe": bent()[7:8]}
    return [path_exhibit(HARD, MESH, paths, RUBBER, truth="fe"),
            path_exhibit("worst", MESH, worst, RUBBER, truth="fe", first=7, steps=STEPS),
            path_exhibit("pressed", MESH, {"fe": bent()}, RUBBER, obstacle=ObstacleSurface(
                np.tile([[[0.05, 0, 0.05], [0.09, 0, 0.05], [0.07, 0.02, 0.05]]], (STEPS + 1, 1, 1)), np.array([[0, 1, 2]])))]

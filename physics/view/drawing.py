"""One body drawn by VTK without a display: where the camera stands, how large the panel is, and its pixels.

A beam along x that bends in z is seen from -y, slightly from above, in parallel projection fitted to what is drawn.

VTK 9.4 and later (PyPI) draw by EGL, which takes Debian's libegl1 and libgl1-mesa-dri. Debian 13's own VTK 9.3 knows X
servers only: there it takes xvfb, and programs run under xvfb-run.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from numpy.typing import NDArray
from vtkmodules import vtkRenderingOpenGL2

from physics.mesh.mesh import Mesh

Floats = NDArray[np.floating[Any]]
Integers = NDArray[np.int64]
Pixels = NDArray[np.uint8]

WIDTH = 1200  # [pixels]
TOWARDS_EYE = np.array([-0.12, -1.0, 0.36]) / np.linalg.norm([-0.12, -1.0, 0.36])


@dataclass(frozen=True)
class ObstacleSurface:
    """The surface of a rigid body: points (M, 3) in one frame or (T, M, 3) in all of them [m], triangles (F, 3)."""

    points: Floats
    triangles: Integers

    def at(self, frame: int) -> ObstacleSurface:
        """The obstacle in one frame."""
        return self if self.points.ndim == 2 else ObstacleSurface(self.points[frame], self.triangles)


def eye_for(mesh: Mesh) -> Floats:
    """Where a body is best seen from: a plane one from above, a plate from a corner, others as a beam along x."""
    length, width, height = np.ptp(mesh.points, axis=0)
    if mesh.dimension == 2:
        return np.array([0.0, 0.0, 1.0])
    if width > 2 * height and width > length / 4:
        return np.array([-0.35, -1.0, 0.8]) / np.linalg.norm([-0.35, -1.0, 0.8])
    return TOWARDS_EYE


@dataclass(frozen=True)
class Camera:
    """Parallel projection: centre [m], half width and half height [m] of what must be seen, direction towards the eye."""

    centre: Floats
    half_width: float
    half_height: float
    eye: Floats


def _axes_of_view(eye: Floats) -> tuple[Floats, Floats]:
    right = np.cross((0, 0, 1), eye) if abs(eye[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    return right, np.cross(eye, right)


def fit(clouds: list[Floats], obstacle: ObstacleSurface | None, eye: Floats = TOWARDS_EYE) -> Camera:
    """A camera that sees the whole body, and of the obstacle what is near: at most half the body's extent beyond it."""
    right, up = _axes_of_view(eye)
    points = np.concatenate(clouds)
    low, high = points.min(axis=0), points.max(axis=0)
    if obstacle is not None:
        margin = 0.5 * (high - low).max()
        near = ((obstacle.points > low - margin) & (obstacle.points < high + margin)).all(axis=1)
        points = np.concatenate([points, obstacle.points[near]])
    flat = points @ np.stack([right, up, eye], axis=1)  # (.., 3) across, up, towards the eye
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle = (low + high) / 2 @ np.stack([right, up, eye])
    half = 1.06 * (high - low) / 2
    return Camera(middle, float(half[0]), float(half[1]), eye)


def panel_size(camera: Camera, panels: int) -> tuple[int, int]:
    """Width and height [pixels], as high as the body needs, between 0.25 and 0.8 (alone: 0.6) of its width."""
    width = WIDTH // panels
    height = width * min(0.8 if panels > 1 else 0.6, max(0.25, camera.half_height / camera.half_width))
    return width, 2 * round(height / 2)


def draw(mesh: Mesh, displacement: Floats, colour: Floats, limits: tuple[float, float], cmap: str, camera: Camera,
          size: tuple[int, int], *, obstacle: ObstacleSurface | None = None, outline: Floats | None = None) -> Pixels:
    """(height, width, 3) picture of a body, coloured by a value at each node (N,) or by red, green and blue on each facet (F, 3)."""
    _find_screen()
    plotter: Any = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    plotter.add_light(pv.Light(light_type="headlight", intensity=0.8))
    plotter.add_light(pv.Light(position=(0, 0, 1), focal_point=(0, 0, 0), light_type="scene light", intensity=0.7))
    plotter.set_background("white")
    body = _surface(mesh, mesh.points + displacement)
    flat = colour.ndim == 2
    (body.cell_data if flat else body.point_data)["colour"] = np.asarray(colour, np.float64)
    scale: dict[str, Any] = {"rgb": True} if flat else {"cmap": colormaps[cmap], "clim": limits}
    # Light tells the faces of a solid apart; a plane body, which faces it all, would only be whiter than the scale beside it.
    ambient, diffuse = (0.55, 0.5) if mesh.dimension == 3 else (1.0, 0.0)
    plotter.add_mesh(body, scalars="colour", **scale, show_scalar_bar=False, show_edges=True,
                     edge_color="#555555", line_width=0.6, ambient=ambient, diffuse=diffuse, specular=0.0)
    if outline is not None:
        edges = feature_edges(mesh)
        if len(edges):  # a round body has none
            lines = pv.PolyData(mesh.points + outline, lines=np.insert(edges, 0, 2, axis=1).ravel())
            plotter.add_mesh(lines, color="#1f4e9c", line_width=1.6, lighting=False)
    if obstacle is not None:
        rigid = pv.PolyData(np.asarray(obstacle.points, np.float64), _faces([obstacle.triangles]))
        plotter.add_mesh(rigid, color="#9a9da1", ambient=0.3, diffuse=0.7, specular=0.1, opacity=0.55)
    distance = 10 * (camera.half_width + camera.half_height)
    _, up = _axes_of_view(camera.eye)
    plotter.camera_position = [camera.centre + distance * camera.eye, camera.centre, up]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = max(camera.half_height, camera.half_width * size[1] / size[0])
    plotter.camera.clipping_range = (0.01 * distance, 3 * distance)
    plotter.enable_anti_aliasing("ssaa")
    picture = plotter.screenshot(None, return_img=True)
    plotter.close()
    return np.asarray(picture)[..., :3]


def feature_edges(mesh: Mesh) -> Integers:
    """(E, 2) nodes of the edges that outline a body at rest: where facets meet at more than 40 degrees, and rims of plane ones."""
    lines = _surface(mesh, mesh.points).extract_feature_edges(40, manifold_edges=False)
    if not lines.n_points:
        return np.zeros((0, 2), np.int64)
    return np.asarray(lines["node"])[lines.lines.reshape(-1, 3)[:, 1:]]


def _surface(mesh: Mesh, points: Floats) -> pv.PolyData:
    surface = pv.PolyData(np.asarray(points, np.float64), _faces(mesh.surface))
    surface["node"] = np.arange(len(points))
    return surface


def _faces(facets: list[Integers]) -> Integers:
    """VTK's list of polygons: the number of nodes before each."""
    return np.concatenate([np.insert(part, 0, part.shape[1], axis=1).ravel() for part in facets])


@cache
def _find_screen() -> None:
    """Make sure that VTK can draw without a display. Raises RuntimeError that says what is missing; VTK would abort."""
    if os.environ.get("DISPLAY"):
        return
    if not hasattr(vtkRenderingOpenGL2, "vtkEGLRenderWindow"):
        raise RuntimeError("this VTK cannot draw without a display: take VTK 9.4 or later from PyPI, or run under xvfb-run")
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    if not vtkRenderingOpenGL2.vtkEGLRenderWindow().SupportsOpenGL():
        raise RuntimeError("no way to draw without a display: apt-get install libegl1 libgl1-mesa-dri")

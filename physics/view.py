"""Pictures and films of a deformed body, drawn without a display.

VTK draws the bodies, matplotlib puts title and colour bar around them, pillow writes the films. A beam along x that bends
in z is seen from -y, slightly from above, in parallel projection fitted to what is drawn.

Without a display VTK 9.4 and later (PyPI) draw by EGL, which takes Debian's libegl1 and libgl1-mesa-dri. Debian 13's own
VTK 9.3 knows X servers only: there it takes xvfb, and programs run under xvfb-run.

Legend: N nodes of the body, M nodes of the obstacle, F facets, T frames. Lengths in [m] come in, pictures show [mm].
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, hsv_to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from vtkmodules import vtkRenderingOpenGL2

from physics.mesh.mesh import Mesh

Floats = NDArray[np.floating[Any]]
Integers = NDArray[np.int64]
Pixels = NDArray[np.uint8]

WIDTH, DPI = 1200, 100  # [pixels], [pixels per inch]
ERROR_COLOURS, SIZE_COLOURS = "YlOrRd", "viridis"
VALUE_COLOURS = "RdBu_r"
TOWARDS_EYE = np.array([-0.12, -1.0, 0.36]) / np.linalg.norm([-0.12, -1.0, 0.36])


@dataclass(frozen=True)
class Obstacle:
    """The surface of a rigid body: points (M, 3) in one frame or (T, M, 3) in all of them [m], triangles (F, 3)."""

    points: Floats
    triangles: Integers

    def at(self, frame: int) -> Obstacle:
        """The obstacle in one frame."""
        return self if self.points.ndim == 2 else Obstacle(self.points[frame], self.triangles)


def frame_picture(path: str | Path, mesh: Mesh, *, prediction: Floats, truth: Floats, step: int, steps: int,
                  obstacle: Obstacle | None = None, names: tuple[str, str] = ("prediction", "finite elements")) -> None:
    """Write one frame as PNG: the prediction left, coloured by its error, over the outline of the truth; the truth right.

    Args:
        mesh: the body at rest
        prediction, truth: (N, 3) displacements [m]
        step, steps: the frame's number and the last one's
        obstacle: where it is in this frame
    """
    error = 1e3 * np.linalg.norm(prediction - truth, axis=1)  # (N,) [mm]
    top = float(error.max()) or 1e-9
    camera = _fit([mesh.points + prediction, mesh.points + truth], obstacle)
    size = _panel_size(camera, 2)
    left = _draw(mesh, prediction, error, (0, top), ERROR_COLOURS, camera, size, obstacle=obstacle, outline=truth)
    right = _draw(mesh, truth, np.zeros_like(error), (0, top), ERROR_COLOURS, camera, size, obstacle=obstacle)
    moved = 1e3 * float(np.linalg.norm(truth, axis=1).max())
    title = f"step {step} of {steps}:  largest error {top:.3g} mm,  largest displacement {moved:.3g} mm"
    page = _Page((left, right), names, (0, top), ERROR_COLOURS, "error: distance of each node from its true place [mm]")
    page.show((left, right), title).save(path)


def film(path: str | Path, mesh: Mesh, displacement: Floats, *, truth: Floats | None = None,
         obstacle: Obstacle | None = None, frames: int = 60, seconds: float = 6.0,
         names: tuple[str, str] = ("prediction", "finite elements")) -> int:
    """Write a GIF of a trajectory, and give the number of its pictures.

    Coloured by the size of the displacement; with a truth, by the error, and the truth beside it.

    Args:
        displacement, truth: (T, N, 3) [m]
        obstacle: with points (T, M, 3)
        frames: pictures at most, evenly spread over the steps
        seconds: how long the film runs, its last picture stands still for one more
    """
    chosen = np.unique(np.linspace(0, len(displacement) - 1, min(frames, len(displacement))).round().astype(int))
    both = displacement if truth is None else np.concatenate([displacement, truth])
    shown = displacement if truth is None else displacement - truth
    colour = 1e3 * np.linalg.norm(shown, axis=2)  # (T, N) [mm]
    limits = (0.0, float(colour.max()) or 1e-9)
    cmap, label = (SIZE_COLOURS, "displacement [mm]") if truth is None else (ERROR_COLOURS, "error [mm]")
    ends = None if obstacle is None else Obstacle(obstacle.points.reshape(-1, 3), obstacle.triangles)
    camera = _fit([mesh.points + both.min(axis=0), mesh.points + both.max(axis=0), mesh.points], ends)
    size = _panel_size(camera, 1 if truth is None else 2)
    page, pictures = None, []
    for k in chosen:
        here = None if obstacle is None else obstacle.at(k)
        panels = [_draw(mesh, displacement[k], colour[k], limits, cmap, camera, size, obstacle=here,
                        outline=None if truth is None else truth[k])]
        if truth is not None:
            panels.append(_draw(mesh, truth[k], np.zeros_like(colour[k]), limits, cmap, camera, size, obstacle=here))
        page = page or _Page(panels, names if truth is not None else ("",), limits, cmap, label)
        largest = f"largest {label.split()[0]} {colour[k].max():.3g} mm"
        pictures.append(page.show(panels, f"step {k} of {len(displacement) - 1}:  {largest}"))
    _write_film(path, pictures, [max(20, round(1e3 * seconds / len(pictures)))] * (len(pictures) - 1) + [1000])
    return len(pictures)


def _write_film(path: str | Path, pictures: list[Image.Image], durations: list[int]) -> None:
    """A GIF that runs for ever, in a folder that is made; durations [ms]. One palette for all pictures, so that colours do not flicker."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    few = [np.asarray(picture) for picture in pictures[::max(1, len(pictures) // 4)] + pictures[-1:]]
    palette = Image.fromarray(np.concatenate(few)).quantize(256, method=Image.Quantize.MEDIANCUT)
    pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=durations, loop=0)


def segment_picture(path: str | Path, mesh: Mesh, segment: Integers, *, obstacle: Obstacle | None = None) -> None:
    """Write the body at rest as PNG, with each facet in the colour of the segment (N,) that most of its nodes belong to."""
    hues = 0.61803398875 * np.arange(segment.max() + 1) % 1  # golden section: numbers that follow each other differ most
    colours = hsv_to_rgb(np.stack([hues, 0.45 + 0.3 * (np.arange(len(hues)) % 2), np.full(len(hues), 0.92)], axis=1))
    facets = [np.take_along_axis(own, (own[:, :, None] == own[:, None]).sum(axis=2).argmax(axis=1)[:, None], axis=1)[:, 0]
              for own in (segment[part] for part in mesh.surface)]
    still, eye = np.zeros_like(mesh.points), _eye(mesh)
    camera = _fit([mesh.points], obstacle, eye)
    panel = _draw(mesh, still, colours[np.concatenate(facets)], (0, 1), SIZE_COLOURS, camera, _panel_size(camera, 1), obstacle=obstacle)
    Image.fromarray(panel).quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def mode_picture(path: str | Path, mesh: Mesh, mode: Floats, *, title: str = "") -> None:
    """Write a mode as PNG, 600 pixels wide; what it shows stands at `mode_film`."""
    _mode_frames(mesh, mode, title, [1.0])[0].save(path)


def mode_film(path: str | Path, mesh: Mesh, mode: Floats, *, title: str = "", frames: int = 20, seconds: float = 1.6) -> None:
    """Write one period of a mode as GIF.

    A displacement (N, 3) of any scale moves the body, the largest one by a sixth of its length, over its outline at rest; a
    scalar (N,) colours it. Plane bodies are seen from above.
    """
    phases = np.cos(2 * np.pi * np.arange(frames) / frames)
    _write_film(path, _mode_frames(mesh, mode, title, phases), [round(1e3 * seconds / frames)] * frames)


def mode_pictures(folder: str | Path, mesh: Mesh, modes: Floats, *, names: Sequence[str]) -> list[str]:
    """Write mode_01.png, mode_01.gif and so on of modes (m, N, 3) or (m, N), with a title for each; their file names."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    written = []
    for i, (mode, name) in enumerate(zip(modes, names, strict=True)):
        stem = f"mode_{i + 1:02d}"
        mode_picture(Path(folder) / f"{stem}.png", mesh, mode, title=f"mode {i + 1}:  {name}")
        mode_film(Path(folder) / f"{stem}.gif", mesh, mode, title=f"mode {i + 1}:  {name}")
        written += [f"{stem}.png", f"{stem}.gif"]
    return written


def _mode_frames(mesh: Mesh, mode: Floats, title: str, phases: Sequence[float] | Floats) -> list[Image.Image]:
    """Pictures of a mode times each of some factors between -1 and 1."""
    largest = float(abs(mode).max() if mode.ndim == 1 else np.linalg.norm(mode, axis=1).max()) or 1.0
    if mode.ndim == 1:
        moved, colour = np.zeros_like(mesh.points), mode / largest
        limits, cmap, label = (-1.0, 1.0), VALUE_COLOURS, "value, largest = 1"
    else:
        moved = mode * (np.ptp(mesh.points, axis=0).max() / 6 / largest)
        colour = np.linalg.norm(mode, axis=1) / largest
        limits, cmap, label = (0.0, 1.0), SIZE_COLOURS, "displacement, largest = 1"
    camera = _fit([mesh.points + moved, mesh.points - moved], None, _eye(mesh))
    size = _panel_size(camera, 2)
    page, pictures = None, []
    for phase in phases:
        shown = colour * phase if mode.ndim == 1 else colour * abs(phase)
        panel = _draw(mesh, moved * phase, shown, limits, cmap, camera, size, outline=0 * moved if mode.ndim == 2 else None)
        page = page or _Page([panel], ("",), limits, cmap, label)
        pictures.append(page.show([panel], title))
    return pictures


def _eye(mesh: Mesh) -> Floats:
    """Where a body is best seen from: a plane one from above, a plate from a corner, others as a beam along x."""
    length, width, height = np.ptp(mesh.points, axis=0)
    if mesh.dimension == 2:
        return np.array([0.0, 0.0, 1.0])
    if width > 2 * height and width > length / 4:
        return np.array([-0.35, -1.0, 0.8]) / np.linalg.norm([-0.35, -1.0, 0.8])
    return TOWARDS_EYE


class _Page:
    """A figure with one or two panels, a title and a colour bar, filled again for every frame of a film."""

    def __init__(self, panels: Sequence[Pixels], names: Sequence[str], limits: tuple[float, float], cmap: str, label: str):
        height, width = panels[0].shape[:2]
        above, below = 76, 74  # [pixels] for title and colour bar
        self.figure = Figure(figsize=(width * len(panels) / DPI, (height + above + below) / DPI), dpi=DPI, facecolor="white")
        self.canvas = FigureCanvasAgg(self.figure)
        whole = height + above + below
        self.images = []
        for i, (panel, name) in enumerate(zip(panels, names, strict=True)):
            axes = self.figure.add_axes((i / len(panels), below / whole, 1 / len(panels), height / whole))
            axes.set_axis_off()
            self.images.append(axes.imshow(panel, interpolation="none", aspect="auto"))
            self.figure.text((i + 0.5) / len(panels), 1 - 66 / whole, name, ha="center", fontsize=11, color="#444444")
        self.title = self.figure.text(0.5, 1 - 30 / whole, "", ha="center", fontsize=13, color="#111111")
        bar = self.figure.add_axes((0.3, 46 / whole, 0.4, 12 / whole))
        colours = ScalarMappable(Normalize(*limits), colormaps[cmap])
        self.figure.colorbar(colours, cax=bar, orientation="horizontal").outline.set_visible(False)
        bar.tick_params(labelsize=9, length=2, color="#444444", labelcolor="#444444")
        bar.set_xlabel(label, fontsize=10, color="#444444", labelpad=2)

    def show(self, panels: Sequence[Pixels], title: str) -> Image.Image:
        for image, panel in zip(self.images, panels, strict=True):
            image.set_data(panel)
        self.title.set_text(title)
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())


@dataclass(frozen=True)
class _Camera:
    """Parallel projection: centre [m], half width and half height [m] of what must be seen, direction towards the eye."""

    centre: Floats
    half_width: float
    half_height: float
    eye: Floats


def _axes_of_view(eye: Floats) -> tuple[Floats, Floats]:
    right = np.cross((0, 0, 1), eye) if abs(eye[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    return right, np.cross(eye, right)


def _fit(clouds: list[Floats], obstacle: Obstacle | None, eye: Floats = TOWARDS_EYE) -> _Camera:
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
    return _Camera(middle, float(half[0]), float(half[1]), eye)


def _panel_size(camera: _Camera, panels: int) -> tuple[int, int]:
    """Width and height [pixels], as high as the body needs, between 0.25 and 0.8 (alone: 0.6) of its width."""
    width = WIDTH // panels
    height = width * min(0.8 if panels > 1 else 0.6, max(0.25, camera.half_height / camera.half_width))
    return width, 2 * round(height / 2)


def _draw(mesh: Mesh, displacement: Floats, colour: Floats, limits: tuple[float, float], cmap: str, camera: _Camera,
          size: tuple[int, int], *, obstacle: Obstacle | None = None, outline: Floats | None = None) -> Pixels:
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
    plotter.add_mesh(body, scalars="colour", **scale, show_scalar_bar=False, show_edges=True,
                     edge_color="#555555", line_width=0.6, ambient=0.55, diffuse=0.5, specular=0.0)
    if outline is not None:
        lines = _surface(mesh, mesh.points).extract_feature_edges(40, manifold_edges=False)
        if lines.n_points:  # a round body has none
            lines.points = (mesh.points + outline)[lines["node"]]
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

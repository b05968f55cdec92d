"""The pictures and films that are asked for: a frame beside its truth, a path, segments, modes."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import hsv_to_rgb
from PIL import Image

from physics.mesh.mesh import Mesh
from physics.view.drawing import Floats, Integers, ObstacleSurface, draw, eye_for, fit, panel_size
from physics.view.page import Page, write_film, write_picture

FILM = 20  # pictures of a mode's film
ERROR_COLOURS, SIZE_COLOURS, VALUE_COLOURS = "YlOrRd", "viridis", "RdBu_r"


def frame_picture(path: str | Path, mesh: Mesh, *, prediction: Floats, truth: Floats, step: int, steps: int,
                  obstacle: ObstacleSurface | None = None, names: tuple[str, str] = ("prediction", "finite elements")) -> None:
    """Write one frame as PNG: the prediction left, coloured by its error, over the outline of the truth; the truth right.

    Args:
        mesh: the body at rest
        prediction, truth: (N, 3) displacements [m]
        step, steps: the frame's number and the last one's
        obstacle: where it is in this frame
    """
    error = 1e3 * np.linalg.norm(prediction - truth, axis=1)  # (N,) [mm]
    top = float(error.max()) or 1e-9
    camera = fit([mesh.points + prediction, mesh.points + truth], obstacle, eye_for(mesh))
    size = panel_size(camera, 2)
    left = draw(mesh, prediction, error, (0, top), ERROR_COLOURS, camera, size, obstacle=obstacle, outline=truth)
    right = draw(mesh, truth, np.zeros_like(error), (0, top), ERROR_COLOURS, camera, size, obstacle=obstacle)
    moved = 1e3 * float(np.linalg.norm(truth, axis=1).max())
    title = f"step {step} of {steps}:  largest error {top:.3g} mm,  largest displacement {moved:.3g} mm"
    page = Page((left, right), names, (0, top), ERROR_COLOURS, "error: distance of each node from its true place [mm]")
    write_picture(path, page.show((left, right), title))


def still_picture(path: str | Path, mesh: Mesh, displacement: Floats, frame: int, *, obstacle: ObstacleSurface | None = None) -> None:
    """Write one frame of displacements (T, N, 3) [m] as PNG, coloured by their size; obstacle: with points (T, M, 3)."""
    size = 1e3 * np.linalg.norm(displacement[frame], axis=1)  # (N,) [mm]
    limits, here = (0.0, float(size.max()) or 1e-9), None if obstacle is None else obstacle.at(frame)
    camera = fit([mesh.points + displacement[frame], mesh.points], here, eye_for(mesh))
    panel = draw(mesh, displacement[frame], size, limits, SIZE_COLOURS, camera, panel_size(camera, 1), obstacle=here)
    page = Page((panel,), ("",), limits, SIZE_COLOURS, "displacement [mm]")
    title = f"step {frame} of {len(displacement) - 1}:  largest displacement {size.max():.3g} mm"
    write_picture(path, page.show((panel,), title))


def film(path: str | Path, mesh: Mesh, displacement: Floats, *, truth: Floats | None = None,
         obstacle: ObstacleSurface | None = None, frames: int = 60, seconds: float = 6.0,
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
    ends = None if obstacle is None else ObstacleSurface(obstacle.points.reshape(-1, 3), obstacle.triangles)
    camera = fit([mesh.points + both.min(axis=0), mesh.points + both.max(axis=0), mesh.points], ends, eye_for(mesh))
    size = panel_size(camera, 1 if truth is None else 2)
    page, pictures = None, []
    for k in chosen:
        here = None if obstacle is None else obstacle.at(k)
        panels = [draw(mesh, displacement[k], colour[k], limits, cmap, camera, size, obstacle=here,
                        outline=None if truth is None else truth[k])]
        if truth is not None:
            panels.append(draw(mesh, truth[k], np.zeros_like(colour[k]), limits, cmap, camera, size, obstacle=here))
        page = page or Page(panels, names if truth is not None else ("",), limits, cmap, label)
        largest = f"largest {label.split()[0]} {colour[k].max():.3g} mm"
        pictures.append(page.show(panels, f"step {k} of {len(displacement) - 1}:  {largest}"))
    write_film(path, pictures, [max(20, round(1e3 * seconds / len(pictures)))] * (len(pictures) - 1) + [1000])
    return len(pictures)


def segment_picture(path: str | Path, mesh: Mesh, segment: Integers, *, obstacle: ObstacleSurface | None = None) -> None:
    """Write the body at rest as PNG, with each facet in the colour of the segment (N,) that most of its nodes belong to."""
    hues = 0.61803398875 * np.arange(segment.max() + 1) % 1  # golden section: numbers that follow each other differ most
    colours = hsv_to_rgb(np.stack([hues, 0.45 + 0.3 * (np.arange(len(hues)) % 2), np.full(len(hues), 0.92)], axis=1))
    facets = [np.take_along_axis(own, (own[:, :, None] == own[:, None]).sum(axis=2).argmax(axis=1)[:, None], axis=1)[:, 0]
              for own in (segment[part] for part in mesh.surface)]
    still, eye = np.zeros_like(mesh.points), eye_for(mesh)
    camera = fit([mesh.points], obstacle, eye)
    panel = draw(mesh, still, colours[np.concatenate(facets)], (0, 1), SIZE_COLOURS, camera, panel_size(camera, 1), obstacle=obstacle)
    write_picture(path, Image.fromarray(panel).quantize(256, dither=Image.Dither.NONE), optimize=True)


def mode_picture(path: str | Path, mesh: Mesh, mode: Floats, *, title: str = "") -> None:
    """Write a mode as PNG, 600 pixels wide; what it shows stands at `mode_film`."""
    write_picture(path, _mode_frames(mesh, mode, title, [1.0])[0])


def mode_film(path: str | Path, mesh: Mesh, mode: Floats, *, title: str = "", frames: int = FILM, seconds: float = 1.6) -> None:
    """Write one period of a mode as GIF.

    A displacement (N, 3) of any scale moves the body, the largest one by a sixth of its length, over its outline at rest; a
    scalar (N,) colours it. Plane bodies are seen from above.
    """
    phases = np.cos(2 * np.pi * np.arange(frames) / frames)
    write_film(path, _mode_frames(mesh, mode, title, phases), [round(1e3 * seconds / frames)] * frames)


def mode_pictures(folder: str | Path, mesh: Mesh, modes: Floats, *, names: Sequence[str], films: bool = True,
                  say: Callable[[str], None] = lambda text: None) -> list[str]:
    """Write mode_01.png, mode_01.gif and so on of modes (m, N, 3) or (m, N), with a title for each; their file names.

    films: False leaves the films out, which take nearly all of the time
    say: is told how long it will take, after the first picture
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    written, started = [], time.perf_counter()
    for i, (mode, name) in enumerate(zip(modes, names, strict=True)):
        stem = f"mode_{i + 1:02d}"
        mode_picture(Path(folder) / f"{stem}.png", mesh, mode, title=f"mode {i + 1}:  {name}")
        written.append(f"{stem}.png")
        if i == 0:
            left = (time.perf_counter() - started) * (len(names) * (1 + films * FILM) - 1)
            say(f"{len(names)} pictures{f' and films of {FILM} each' if films else ''}: about {left:.0f} s more")
        if films:
            mode_film(Path(folder) / f"{stem}.gif", mesh, mode, title=f"mode {i + 1}:  {name}")
            written.append(f"{stem}.gif")
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
    camera = fit([mesh.points + moved, mesh.points - moved], None, eye_for(mesh))
    size = panel_size(camera, 2)
    page, pictures = None, []
    for phase in phases:
        shown = colour * phase if mode.ndim == 1 else colour * abs(phase)
        panel = draw(mesh, moved * phase, shown, limits, cmap, camera, size, outline=0 * moved if mode.ndim == 2 else None)
        page = page or Page([panel], ("",), limits, cmap, label)
        pictures.append(page.show([panel], title))
    return pictures

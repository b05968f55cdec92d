"""Pictures and films of a flow in the plane, coloured by its vorticity dv/dx - du/dy [1/s], a prediction beside its truth.

The vorticity at a node is that of the linear functions on the cells around it, each by its area. Colours end at what one node in a
hundred exceeds, because walls have far more than the wake. Legend: T frames, N nodes, C cells.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from physics.mesh.mesh import Mesh
from physics.view.drawing import Floats, Pixels, draw, eye_for, fit, panel_size
from physics.view.page import Page, write_film, write_picture

COLOURS, LABEL = "RdBu_r", "vorticity [1/s]"


def vorticity(mesh: Mesh, velocity: Floats) -> Floats:
    """(T, N) [1/s] of velocities (T, N, 2 or 3) [m/s] on a mesh of triangles."""
    a, b, c = np.moveaxis(mesh.points[mesh.cells][..., :2], 1, 0)
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]  # the cells' areas
    opposite = np.stack([c - b, a - c, b - a], axis=1)  # (C, 3, 2): grad of corner i is this, turned by a right angle, over `twice`
    at = velocity[:, mesh.cells, :2].astype(np.float64)  # (T, C, 3, 2)
    circulation = np.einsum("tcid,cid->tc", at, opposite) * np.sign(twice) / -2  # vorticity times area
    nodes = len(mesh.points)
    found = np.array([np.bincount(mesh.cells.ravel(), np.repeat(row, 3), nodes) for row in circulation])
    return found / np.bincount(mesh.cells.ravel(), np.repeat(abs(twice) / 2, 3), nodes)


def flow_picture(path: str | Path, mesh: Mesh, velocity: Floats, frame: int, *, truth: Floats | None = None,
                 names: tuple[str, str] = ("prediction", "finite elements")) -> None:
    """Write one frame of velocities (T, N, 3) [m/s] as PNG, beside a truth where there is one."""
    chosen = [flow[frame][None] for flow in (velocity, truth) if flow is not None]
    drawn = _Drawn(mesh, chosen, names)
    fastest = float(np.linalg.norm(velocity[frame], axis=1).max())
    title = f"frame {frame} of {len(velocity) - 1}:  largest speed {fastest:.3g} m/s"
    write_picture(path, drawn.page(0).show(drawn.panels(0), title))


def flow_film(path: str | Path, mesh: Mesh, velocity: Floats, *, truth: Floats | None = None, frames: int = 60, seconds: float = 6.0,
              names: tuple[str, str] = ("prediction", "finite elements")) -> int:
    """Write a GIF of velocities (T, N, 3) [m/s], beside a truth where there is one; the number of its pictures."""
    chosen = np.unique(np.linspace(0, len(velocity) - 1, min(frames, len(velocity))).round().astype(int))
    drawn = _Drawn(mesh, [flow[chosen] for flow in (velocity, truth) if flow is not None], names)
    page, pictures = drawn.page(0), []
    for k, frame in enumerate(chosen):
        fastest = float(np.linalg.norm(velocity[frame], axis=1).max())
        pictures.append(page.show(drawn.panels(k), f"frame {frame} of {len(velocity) - 1}:  largest speed {fastest:.3g} m/s"))
    write_film(path, pictures, [max(20, round(1e3 * seconds / len(pictures)))] * (len(pictures) - 1) + [1000])
    return len(pictures)


class _Drawn:
    """One or two flows over the same frames."""

    def __init__(self, mesh: Mesh, flows: list[Floats], names: tuple[str, str]) -> None:
        self.mesh, self.values = mesh, [vorticity(mesh, flow) for flow in flows]
        top = float(np.quantile(abs(self.values[-1]), 0.99)) or 1e-9
        self.limits = (-top, top)
        self.camera = fit([mesh.points], None, eye_for(mesh))
        self.size, self.names = panel_size(self.camera, len(flows)), names[:len(flows)] if len(flows) > 1 else ("",)

    def panels(self, frame: int) -> list[Pixels]:
        still = np.zeros_like(self.mesh.points)
        return [draw(self.mesh, still, values[frame], self.limits, COLOURS, self.camera, self.size) for values in self.values]

    def page(self, frame: int) -> Page:
        return Page(self.panels(frame), self.names, self.limits, COLOURS, LABEL)

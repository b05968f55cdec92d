"""The mesh of a body, whatever its shape."""

from __future__ import annotations

from dataclasses import replace

from physics.mesh.cell import SECOND
from physics.mesh.files import read_mesh
from physics.mesh.formats.drawing import Cut
from physics.mesh.mesh import Mesh
from physics.mesh.second import second_order
from physics.mesh.shapes.boxes import box, rectangle
from physics.mesh.shapes.channel import channel
from physics.mesh.shapes.graded import graded_channel
from physics.mesh.shapes.panel import panel
from physics.scene import PLANE_CELLS, Body


def build_mesh(body: Body, cut: Cut | None = None) -> Mesh:
    """The mesh of a body, built or read; of order 2 it has second-order cells. Raises `InputError` when a file is not sound.

    Args: cut: how a drawing is cut into cells, if not by the body's own cell_size
    """
    if body.shape == "file":
        assert body.path is not None
        mesh = read_mesh(body.path, order=body.order, scale=body.scale, cut=cut or Cut(body.cell_size))
    elif body.shape == "channel":
        mesh = channel(body) if body.hole_cell_size is None else graded_channel(body)
    elif body.shape == "panel":
        mesh = panel(body)
    else:
        mesh = rectangle(body) if body.cell in PLANE_CELLS else box(body)
    return across(of_order(mesh, body), body)


def of_order(mesh: Mesh, body: Body) -> Mesh:
    """The mesh with cells of second order where a body asks for them and it has none."""
    return second_order(mesh) if body.order == 2 and mesh.cell in SECOND else mesh


def across(mesh: Mesh, body: Body) -> Mesh:
    """The mesh of a body with what a plane one is across its plane."""
    if mesh.dimension == 3:
        return mesh
    return replace(mesh, thickness=body.thickness or 1.0, sheet=body.plane == "stress")

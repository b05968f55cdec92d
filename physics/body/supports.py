"""What holds and loads a body: held components, tractions, dead pressures. Legend: N nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physics.body.pressure import POINTS, pressure_force, tangents
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.mesh.sound.fit import described, joined, piece_of
from physics.mesh.sound.rows import rows_in, unique_rows
from physics.scene import Scene, Where
from physics.schema import InputError

Floats = NDArray[np.float64]
MOST_PARTS = 100  # whose hinges are looked at


def held(scene: Scene, mesh: Mesh) -> NDArray[np.bool_]:
    """(N, 3) True on the components that a support holds."""
    fixed = np.zeros(mesh.points.shape, bool)
    for support in scene.support:
        for letter in support.fixed:
            fixed[mesh.place(support.where), "xyz".index(letter)] = True
    fixed[:, mesh.dimension:] = True  # a plane body stays in its plane
    return fixed


def rigid_motions_left(mesh: Mesh, fixed: NDArray[np.bool_]) -> int:
    """How many of the six rigid motions the held components (N, 3) leave free."""
    x = (mesh.points - mesh.points.mean(axis=0)) / (np.ptp(mesh.points) or 1.0)  # a lone node has no extent
    motions = [np.broadcast_to(axis, x.shape) for axis in np.eye(3)] + [np.cross(axis, x) for axis in np.eye(3)]
    at_held = np.stack([motion[fixed] for motion in motions], axis=1)
    return 6 - int(np.linalg.matrix_rank(at_held, tol=1e-9 * len(at_held) ** 0.5)) if len(at_held) else 6


def pieces_held(scene: Scene, mesh: Mesh) -> tuple[str, ...]:
    """What holds each piece of a body of several, in one remark; nothing for a body that hangs together."""
    label = piece_of(len(mesh.points), mesh.cells)
    count = int(label.max()) + 1
    if count == 1:
        return ()
    holders = {piece: [f"{support.where!r}" for support in scene.support if (label[mesh.place(support.where)] == piece).any()]
               for piece in range(count)}
    words = [f"piece {piece + 1} by {' and '.join(dict.fromkeys(names)) or 'nothing'}" for piece, names in holders.items()]
    return (f"held are {'; '.join(words[:5])}{'; ...' if count > 5 else ''}",)


def loose(mesh: Mesh, fixed: NDArray[np.bool_]) -> str:
    """Which rigid motions the held components (N, 3) leave free, of each piece and of parts that hinge on shared nodes; "" if none."""
    part, nodes = joined(mesh.cells, mesh.cell), len(mesh.points)
    whole = not part.any() and np.bincount(mesh.cells.ravel(), minlength=nodes).all()
    label = np.zeros(nodes, np.int64) if whole else piece_of(nodes, mesh.cells)
    count = int(label.max()) + 1
    for piece in range(count):
        own = label == piece
        if free := rigid_motions_left(replace(mesh, points=mesh.points[own]), fixed[own]):
            many = f"{free} rigid motion{'s' if free > 1 else ''}"
            if count == 1:
                return f"{many} of the body left free; fix more components"
            return f"{many} of one of {count} pieces left free: {described(mesh.points, mesh.cells, label, piece)}; fix more components"
    if free := _hinged(mesh, fixed, part):
        return (f"{free} motion{'s' if free > 1 else ''} left free: parts of the mesh hang together at single nodes or edges and turn "
                "about them; let them share faces, or fix more components")
    return ""


def _hinged(mesh: Mesh, fixed: NDArray[np.bool_], part: NDArray[np.int64]) -> int:
    """How many motions are free when each part (C,) that hangs together by facets is rigid, and parts move together at shared nodes."""
    count = int(part.max()) + 1
    if not 1 < count <= MOST_PARTS:
        return 0
    x = (mesh.points - mesh.points.mean(axis=0)) / np.ptp(mesh.points)
    pairs = np.unique(np.stack([mesh.cells.ravel(), np.repeat(part, mesh.cells.shape[1])], axis=1), axis=0)  # node and part
    node, owner = pairs.T
    motion = np.zeros((len(pairs), 3, 6 * count))  # of each node with each of its parts, for six motions of each part
    turns = np.cross(np.eye(3)[None], x[node][:, None]).transpose(0, 2, 1)
    own = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)
    for i in range(6):
        motion[np.arange(len(pairs)), :, 6 * owner + i] = own[:, :, i]
    shared = np.flatnonzero(node[1:] == node[:-1])
    ties = np.concatenate([(motion[shared] - motion[shared + 1]).reshape(-1, 6 * count), motion[fixed[node]]])
    return 6 * count - int(np.linalg.matrix_rank(ties.T @ ties, tol=1e-9 * len(ties), hermitian=True))


def traction_load(scene: Scene, mesh: Mesh) -> Floats:
    """(N, 3) nodal forces [N] of tractions and dead pressures, over rest facets, at the last step.

    Raises:
        InputError: a place is an edge or a point, which has no facet, or a region, of which nobody said which
    """
    force = np.zeros_like(mesh.points)
    for i, load in enumerate(scene.load):
        if load.traction is not None and load.where is not None:
            facets = mesh.facets(load.where)
            if wrong := _no_face(mesh, load.where, facets):
                raise InputError(f"load[{i}].where = {load.where!r}: {wrong}; a traction needs a face")
            force += _areas(mesh, facets)[:, None] * np.array(load.traction)
        if load.pressure is not None and load.where is not None and not load.follower:
            force += pressure_force(mesh, mesh.points, outer_facets(mesh, load.where, f"load[{i}].where"), load.pressure)
    return force


def outer_facets(mesh: Mesh, where: str | Where, key: str) -> list[NDArray[np.int64]]:
    """The facets (F, k) of a place that a pressure acts on, outward. Raises `InputError` when it has none, or inner ones."""
    facets = mesh.facets(where)
    wrong = _no_face(mesh, where, facets)
    inner = sum(int(rows_in(some, outer).size - rows_in(some, outer).sum()) for some, outer in zip(facets, mesh.boundary, strict=True))
    if wrong or inner:
        raise InputError(f"{key} = {where!r}: {wrong or f'{inner} of its facets lie inside the body'}; a pressure needs an outer face")
    return facets


def _no_face(mesh: Mesh, where: str | Where, facets: list[NDArray[np.int64]]) -> str:
    """Why a place, with the facets (F, k) that the mesh has there, is no face of the body; "" where it is one."""
    parts = [] if isinstance(where, Where) else mesh.parts.get(where, [])
    found = sum(map(len, facets))
    if any(kind == mesh.cell for kind, _ in parts):
        return "is a region, and which of its facets are meant is not said"
    faces = sum(len(unique_rows(np.sort(cells, axis=1))) for kind, cells in parts if CELLS[kind].dimension == mesh.dimension - 1)
    if found < faces:
        return f"{faces - found} of its {faces} faces are no sides of the body's cells"
    return "" if found else "has no facet"


def nodal_areas(mesh: Mesh, place: str | Where) -> Floats:
    """(N,) integral of each node's shape function over the facets of a place, of a plane body times its thickness [m2]."""
    return _areas(mesh, mesh.facets(place))


def _areas(mesh: Mesh, found: list[NDArray[np.int64]]) -> Floats:
    """The same over some facets (F, k)."""
    areas = np.zeros(len(mesh.points))
    for facets in found:
        x, kind = mesh.points[facets], mesh.kind_of(facets)
        if kind == "line":
            share = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)[:, None] * mesh.thickness / 2
        elif kind == "triangle":
            share = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)[:, None] / 6
        elif kind == "quadrilateral":
            share = _bilinear_shares(x)
        else:  # of second order: nothing at the corners of a flat triangle
            weight, shape, _ = POINTS[kind]
            tangent = tangents(mesh, mesh.points, facets)
            share = np.einsum("g,fg,ga->fa", weight, np.linalg.norm(np.cross(tangent[:, :, 0], tangent[:, :, 1]), axis=2), shape)
        np.add.at(areas, facets, share)
    return areas


def _bilinear_shares(x: Floats) -> Floats:
    """(F, 4) integrals of the bilinear shape functions over quadrilaterals (F, 4, 3), by 2 x 2 Gauss points."""
    shares = np.zeros(x.shape[:2])
    sign = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for point in sign / np.sqrt(3):
        shape = np.prod(1 + sign * point, axis=1) / 4  # (4,)
        slope = sign * (1 + sign * point)[:, ::-1] / 4  # (4, 2)
        tangent = np.einsum("ak,fad->fkd", slope, x)
        shares += np.linalg.norm(np.cross(tangent[:, 0], tangent[:, 1]), axis=1)[:, None] * shape
    return shares

"""Which meshes may a body have, from coarse to fine, and at which points are they compared?

A beam or plate is cut into hexahedra, of first order (with one dilatation a cell) or of second, with numbers along x, y and z that grow by
themselves; a plane plate into its cells, of either order. A panel has numbers in its plane and of its layers, in tetrahedra. A drawing is
cut into cells of any size (drawn.py). A file's own mesh is taken as it is, at first and at second order, and cut in halves. Solutions are
compared at points that all meshes of a body share: the middles of a regular grid in a box, else those of the cells of the coarsest mesh.
Boxes that clamped faces alone bear are graded to these and to where round obstacles press them, which meet a smooth surface.

Triangles of second order come in even numbers: their diagonals alternate, so that of odd and even numbers other corners of the body are
cut, where stress is singular, and an error that falls from even to even need not from even to odd.

Legend: M points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.accuracy.meshes.drawn import Drawing
from physics.body.element import samples
from physics.contact.obstacles import Rigid
from physics.mesh.build import across, build_mesh, of_order
from physics.mesh.cell import CELLS, SECOND
from physics.mesh.formats.drawing import Cut
from physics.mesh.mesh import Mesh
from physics.mesh.refine import halved
from physics.mesh.second import corners_only, is_curved
from physics.scene import FOCUS, PLACES, PLANE_CELLS, Body, Obstacle, Scene

Floats = NDArray[np.float64]
Sizes = tuple[int, ...]

ALONG = 6  # cells along the longest side of the coarsest mesh
GROWTH = 1.5  # from one number of cells to the next
STIFF = 0.45  # Poisson's ratio from which second-order cells have mean dilatation
LOCAL = 0.5  # of a side over which cells get shorter around an obstacle, at most
GRID = 10  # points of comparison along the longest side of a box
MOST_POINTS = 800
ROUND = 0.1  # of a halving that may be wanting


@dataclass(frozen=True)
class MeshFamily:
    """Meshes of one body with cells of one order.

    base: the coarsest; axes: what its numbers count
    drawn: of a drawing that takes any size
    own: of a file the mesh in it, of second order if its sides are curved, so that finer ones of any order have their corners on them
    """

    scene: Scene
    order: int
    base: Sizes
    axes: tuple[str, ...]
    own: Mesh | None = field(default=None, compare=False)
    drawn: Drawing | None = field(default=None, compare=False)

    @property
    def body(self) -> Body:
        return self.scene.body

    def after(self, sizes: Sizes, axis: int) -> Sizes:
        """The next finer mesh along an axis; a file's cells are halved."""
        n = sizes[axis]
        following = 2 * n if self.own is not None else self.whole(max(n + 1, math.ceil(GROWTH * n)))
        return (*sizes[:axis], following, *sizes[axis + 1:])

    def finer(self, sizes: Sizes, times: Sequence[float]) -> Sizes:
        """The mesh with so many times the cells along each axis; a file's cells are halved as often as it takes."""
        if self.own is not None:
            return (sizes[0] * 2 ** math.ceil(math.log2(times[0]) - ROUND),)
        return tuple(self.whole(math.floor(n * ratio + 0.5)) for n, ratio in zip(sizes, times, strict=True))

    def whole(self, n: int) -> int:
        """The least number of cells of this kind that is not below n."""
        return n + n % 2 if self.order == 2 and self.body.cell == "triangle" else n

    @property
    def dimension(self) -> int:
        """3 for a solid body, 2 for a plane one."""
        return sum(self.spans)

    @property
    def spans(self) -> Sizes:
        """How many directions of the body each number counts cells along."""
        if self.drawn is not None:
            return (self.drawn.dimension,)
        return (self.own.dimension,) if self.own is not None else (2, 1) if self.body.shape == "panel" else (1,) * len(self.base)

    def rung(self, sizes: Sizes) -> tuple[Scene, Mesh]:
        """The scene with the mesh of these numbers, and the mesh."""
        scene = self.scene_with(sizes)
        if self.drawn is not None:
            return scene, self.drawn.mesh(sizes[0])
        mesh = self.own
        if mesh is None:
            return scene, build_mesh(scene.body)
        for _ in range(round(math.log2(sizes[0]))):
            mesh = halved(mesh)
        if self.order == 1 and CELLS[mesh.cell].middles:
            mesh = corners_only(mesh)
        return scene, across(of_order(mesh, scene.body), scene.body)

    def learn(self, sizes: Sizes, poses: Floats) -> None:
        """Take what is known on a mesh, displacements (K, N, 3) of poses or modes, for where finer meshes of a drawing should be fine."""
        if self.drawn is not None:
            self.drawn.learn(sizes[0], poses, self.scene.material)

    def scene_with(self, sizes: Sizes) -> Scene:
        """The scene with the mesh of these numbers, in the keys of its body as far as they can say it."""
        body, steps = self.body, replace(self.scene.steps, error=None, quantity=None)
        ratio = max(material.poisson_ratio for material in self.scene.materials)
        if body.shape == "file":
            kind = self.drawn.kind if self.drawn is not None else self.own.cell if self.own is not None else ""
            solid = self.dimension == 3 and (kind not in ("tetrahedron", "tetrahedron10") or self.order == 2)
            size = None if self.drawn is None else self.drawn.longest / sizes[0]
            body = replace(body, order=self.order, element="mean-dilatation" if solid and ratio >= STIFF else "standard", cell_size=size)
            return replace(self.scene, body=body, steps=steps)
        if body.shape == "panel":
            body = replace(body, cell="tetrahedron", cell_size=max(body.extent) / sizes[0], layers=sizes[1], order=self.order)
        elif len(sizes) == 2:
            body = replace(body, cells=sizes, order=self.order)
        else:
            body = replace(body, cells=sizes, cell="hexahedron", order=self.order)
        free = body.cell == "hexahedron" and self.order == 1
        if free or (body.cell not in PLANE_CELLS and body.order == 2 and ratio >= STIFF):
            body = replace(body, element="mean-dilatation")
        return replace(self.scene, body=body, steps=steps)

    def said(self, sizes: Sizes) -> str:
        """The cells in words."""
        order = "second" if self.order == 2 else "first"
        if self.drawn is not None:
            graded = ", graded" if sizes != self.base else ""
            return f"about {sizes[0]} {CELLS[self.drawn.kind].plural} along the drawing, {order} order{graded}"
        if self.body.shape == "file":
            return f"the file's own, {order} order" + (f", each side in {sizes[0]}" if sizes[0] > 1 else "")
        kind = "tetrahedra" if self.body.shape == "panel" else CELLS[self.body.cell].plural if len(sizes) == 2 else "hexahedra"
        to = [*(self.body.graded or ()), *["contact"] * any(self.body.focus)]
        graded = f", graded to {' and '.join(to)}" if to else ""
        return f"{' x '.join(map(str, sizes))} {kind}, {order} order{graded}"

    @property
    def highest(self) -> float:
        """The order of convergence of smooth displacements in the mean square."""
        return 2.0 if self.order == 1 else 4.0


def families(scene: Scene) -> list[MeshFamily]:
    """The ways to mesh a body, that of second order first. Raises `InputError` when a file is not sound."""
    scene = _smooth(scene)
    body = scene.body
    width = min((Rigid(obstacle).width for obstacle in scene.obstacles), default=math.inf)
    width *= 1 if any(obstacle.contact == "nodes" for obstacle in scene.obstacles) else 2
    if body.drawn:
        cut = build_mesh(replace(body, order=1), Cut(parts=ALONG))
        both = [Drawing(body, order, cut) for order in (2, 1)]
        if both[1].follows:
            n = max(ALONG, math.ceil(both[0].longest / width))
            return [MeshFamily(scene, one.body.order, (n,), ("along the drawing",), drawn=one) for one in both]
    if body.shape == "file":
        mesh = build_mesh(replace(body, order=1))
        second = mesh.cell in SECOND
        if second and is_curved(curved := build_mesh(replace(body, order=2))):
            mesh = curved
        first = MeshFamily(scene, 1, (1,), ("the file's cells",), mesh)
        return [replace(first, order=2), first] if second else [first]
    if body.shape != "panel":
        clamped, spots = _clamped(scene), _pressed(scene)
        body = replace(body, graded=None) if not clamped or spots is None else replace(body, graded=clamped, **spots)
        scene = replace(scene, body=body)
    extent, longest = [side for side in body.extent if side], max(body.extent)
    size = min(longest / ALONG, width)

    def base(least: int) -> Sizes:
        return tuple(max(least, math.ceil(side / size * (1 - 1e-9))) for side in extent)

    if body.shape == "panel":
        holes = [2 * radius for _, _, radius in body.holes or ()]
        n = math.ceil(longest / min([size, *holes]))
        return [MeshFamily(scene, order, (n, max(order_layers, math.ceil(extent[2] / size))), ("in the plane", "layers"))
                for order, order_layers in ((2, 1), (1, 2))]
    if body.cell in PLANE_CELLS:
        kinds = [MeshFamily(scene, order, base(least), ("x", "y")) for order, least in ((2, 1), (1, 2))]
        return [replace(kind, base=tuple(map(kind.whole, kind.base))) for kind in kinds]
    return [MeshFamily(scene, order, base(least), ("x", "y", "z")) for order, least in ((2, 1), (1, 2))]


def _clamped(scene: Scene) -> tuple[str, ...]:
    """The faces of a box that its supports hold in all directions; none where a support elsewhere bears it too, for cells should not be
    longer there."""
    plane = scene.body.cell in PLANE_CELLS
    held = {face: {axis for support in scene.support if support.where == face for axis in support.fixed} for face in PLACES}
    clamped = tuple(face for face in PLACES if held[face] >= set("xy" if plane else "xyz"))
    return clamped if all(support.where in clamped for support in scene.support) else ()


def _pressed(scene: Scene) -> dict[str, Any] | None:
    """Where obstacles press a box, along the axes across their way: each over half of how far it reaches along them.

    None where one of them presses no such place, as one with edges, or one that slides: there cells should not be longer than elsewhere.
    Nor where one meets facets, over which errors fall by no order.
    """
    spots: dict[str, list[tuple[float, float]]] = {}
    for obstacle in scene.obstacles:
        if obstacle.contact != "smooth":
            return None
        path, before = np.array(obstacle.path), sum(map(len, spots.values()))
        for axis, (key, side) in enumerate(zip(FOCUS, scene.body.extent, strict=True)):
            way, within = path[:, axis], _reach(obstacle, axis, scene.body) / 2
            if within < LOCAL * side and 0 <= way.min() and way.max() <= side and np.ptp(way) < within:
                spots.setdefault(key, []).append((float(way.mean()), within))
        if sum(map(len, spots.values())) == before:
            return None
    return {key: tuple(found) for key, found in spots.items()}


def _reach(obstacle: Obstacle, axis: int, body: Body) -> float:
    """How far an obstacle reaches along an axis from its centre [m], a cylinder where it lies over the body; for ever with edges."""
    if obstacle.shape in ("box", "half-space"):
        return math.inf
    if obstacle.shape != "cylinder":
        return Rigid(obstacle).shape.reach(np.eye(3)[axis])
    assert obstacle.radius is not None
    along = np.abs(obstacle.axis) / np.linalg.norm(obstacle.axis)
    sides = [(body.extent[other], along[other]) for other in range(3) if other != axis and along[other] > 0]
    over = min((side / 2 / share for side, share in sides), default=math.inf)
    return float(obstacle.radius * math.sqrt(1 - along[axis]**2) + (over * along[axis] if along[axis] > 0 else 0.0))


def _smooth(scene: Scene) -> Scene:
    """The scene with a smooth surface where it meets obstacles that roll over it, all but half-spaces, unless they ask for nodes.

    In steps from facet to facet, errors fall from mesh to mesh by no order. What is flat everywhere rolls over nothing, and presses
    evenly, where a smooth surface gives way the most.
    """
    each = tuple(one if one.contact != "facets" or one.shape == "half-space" else replace(one, contact="smooth") for one in scene.obstacles)
    return replace(scene, obstacle=each if isinstance(scene.obstacle, tuple) else each[0] if each else None)


def meshed(scene: Scene) -> list[Scene]:
    """The scene, or where it asks for an error the coarsest of each kind of mesh that it may get."""
    return [scene] if scene.steps.error is None else [family.rung(family.base)[0] for family in families(scene)]


def points_of(family: MeshFamily) -> tuple[Floats, Floats]:
    """Points (M, 3) at which solutions are compared, and their shares (M,) of the volume."""
    body = family.body
    if body.shape in ("beam", "plate"):
        longest, plane = max(body.extent), body.cell in PLANE_CELLS
        numbers = [1 if not side else max(3, round(GRID * side / longest)) for side in body.extent]
        lines = [(np.arange(n) + 0.5) / n * side for n, side in zip(numbers, body.extent, strict=True)]
        points = np.array(list(product(*lines)))
        points[:, 2] *= not plane
        return points, np.full(len(points), 1 / len(points))
    _, mesh = replace(family, order=1).rung(family.base)
    some = slice(None, None, -(-len(mesh.cells) // MOST_POINTS))
    volume = samples(mesh).volumes.sum(axis=0)[some]
    return mesh.points[mesh.cells[some]].mean(axis=1), volume / volume.sum()

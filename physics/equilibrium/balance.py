"""The equations of a scene: f(u) = b + sum_q p_q n_q on the free components of the displacement u.

f = dW/du are the internal forces (elasticity.py), less pressures that follow their faces (pressure.py), b the dead loads,
p_q >= 0 the forces of contact (contact/conditions.py); held components follow their prescription. Loads and prescribed displacements
grow linearly with the fraction 0 .. 1 of the loading or go by a table (schedule.py), obstacles are on their paths.
Legend: N nodes, Q contact points.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from physics.body.elasticity import Elasticity
from physics.body.lumped import Lumped
from physics.body.material import cellwise
from physics.body.pressure import Pressed
from physics.body.schedule import Moves, largest_share, scheduled, share
from physics.body.supports import held, loose, outer_facets, traction_load
from physics.contact.conditions import CONTACT_STIFFNESS, cell_size
from physics.contact.obstacles import buried
from physics.contact.touch import contact_of
from physics.mesh.build import across
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.scene import Load, Scene
from physics.scene.plane import check_plane
from physics.scene.rules import is_plane
from physics.schema import InputError

Floats = NDArray[np.float64]

GAP_TOLERANCE = 1e-6  # error of a gap over the size of a cell
STRONGEST = 1e3  # of a load, in units of Young's modulus
FARTHEST = 1e4  # of an obstacle's path, in lengths that are safe for one step
TOUCHING = 0.05  # of a cell size, for a residual
TURNED = 0.1  # of the smallest extent of the body that a node may move before a factor is made anew for correcting predictions


class Balance:
    """The equations of one scene on one mesh.

    Attributes:
        fixed: (N, 3) True on held components; moves: their displacements
        load: (N, 3) dead loads at the last step that grow evenly [N]; tabled: those that go by a table, in full
        pressed: the body, where pressures follow its faces
        body: internal forces; elasticity: of the step, which in motion has inertia in it; contact: None without an obstacle
        size: of a cell [m]
        floor: force [N] below which rounding in f(u) takes over
        bearing: nodes whose forces are the reaction when there is no obstacle: of supports that move, else of all of them
    """

    def __init__(self, scene: Scene, mesh: Mesh, *, method: str | None = None, spread: bool = False) -> None:
        """Args: method, spread: of the linear algebra, as in `factor.solver_for`.

        Raises:
            InputError: the body is free to move, of prisms of second order, or the obstacle starts inside of it
        """
        if mesh.dimension == 2:
            check_plane(scene)
        if scene.body.order == 2 and not CELLS[mesh.cell].middles:
            raise InputError(f"body.order = 2: {CELLS[mesh.cell].plural} are of first order only; take tetrahedra or hexahedra")
        mesh = across(mesh, scene.body)
        self.scene, self.mesh, self.size, self.method, self.spread = scene, mesh, cell_size(mesh), method, spread
        self.thin = float(mesh.extent.min())  # [m]
        self.fixed, self.moves = held(scene, mesh), Moves(scene, mesh)
        self.bearing = np.flatnonzero(self.moves.nodes if self.moves.nodes.any() else self.fixed.any(axis=1))
        following = [(outer_facets(mesh, load.where, f"load[{i}].where"), load) for i, load in enumerate(scene.load)
                     if load.follower and load.where is not None]
        self.pressed = Pressed(mesh, scene.material, self.fixed, scene.body.element, following) if following else None
        self.body = self.pressed or Elasticity(mesh, scene.material, self.fixed, scene.body.element)
        self.elasticity: Elasticity | Lumped = self.body
        self.load = self.full([load for load in scene.load if not scheduled(load)], self.body.weight)
        self.tabled = [(load, self.full([load], self.body.weight)) for load in scene.load if scheduled(load) and not load.follower]
        self.contact = contact_of(scene.obstacles, mesh, self.fixed.all(axis=1), CONTACT_STIFFNESS * self._moduli() / self.size)
        # eps E h L: strains come from differences of positions that differ by up to the largest extent L.
        self.floor = 1e3 * float(np.finfo(float).eps) * scene.stiffest * self.size * float(np.ptp(mesh.points))
        self._check()

    def _moduli(self) -> float | Floats:
        """Young's modulus [Pa], of several materials at each node (N,): the mean of the cells around it."""
        young = cellwise(self.scene.material, self.mesh, lambda material: material.young_modulus)
        if not isinstance(young, np.ndarray):
            return young
        nodes, count = self.mesh.cells.ravel(), len(self.mesh.points)
        of_cells = np.repeat(young, self.mesh.cells.shape[1])
        return np.bincount(nodes, of_cells, count) / np.maximum(np.bincount(nodes, minlength=count), 1)

    def full(self, loads: list[Load], weight: Callable[[Floats], Floats]) -> Floats:
        """(N, 3) [N] some dead loads in full. Args: weight: nodal forces (N, 3) [N] of an acceleration (3,)"""
        force = traction_load(replace(self.scene, load=tuple(loads)), self.mesh)
        for load in loads:
            if load.acceleration is not None:
                force += weight(np.array(load.acceleration))
        return force

    @property
    def target(self) -> Floats:
        """(N, 3) [m] displacements at the last step of the components that are moved evenly."""
        return self.moves.target

    @property
    def varied(self) -> bool:
        """True when some load or support does not simply grow with the steps."""
        return self.moves.varied or any(scheduled(load) for load in self.scene.load)

    @property
    def loaded(self) -> bool:
        """True when loads or supports that move do something to the body."""
        return bool(self.load.any() or self.target.any() or self.pressed is not None or self.tabled or self.moves.varied)

    def apply_loads(self, fraction: float) -> Floats:
        """(N, 3) dead loads [N] at a fraction of the loading; from now on pressures that follow their faces act as there."""
        if self.pressed is not None:
            self.pressed.fraction = fraction
        return sum((share(load, fraction) * force for load, force in self.tabled), fraction * self.load)

    def moved(self, fraction: float) -> Floats:
        """(N, 3) [m] displacements of the held components at a fraction of the loading."""
        return self.moves.at(fraction)

    def work(self, u: Floats, fraction: float) -> float:
        """[J] of the loads as they are at a fraction of the loading, up to displacements (N, 3)."""
        even = fraction * float((self.load * u).sum())
        work = sum((float((share(load, fraction) * force * u).sum()) for load, force in self.tabled), even)
        self.apply_loads(fraction)
        return work + (0.0 if self.pressed is None else self.pressed.work(u))

    def rests(self, fraction: float) -> bool:
        """True when the rest state is in balance: nothing loads, moves or touches the body."""
        if self.loaded:
            return False
        return self.clearance(fraction) >= -GAP_TOLERANCE * self.size

    def clearance(self, fraction: float) -> float:
        """Smallest gap [m] between the body at rest and the obstacle."""
        if self.contact is None:
            return float("inf")
        return float(self.contact.gaps(np.zeros_like(self.mesh.points), self.contact.obstacle.position(fraction))[0].min(initial=np.inf))

    def missing(self, u: Floats, fraction: float) -> tuple[Floats, Floats]:
        """What any displacements (N, 3) lack to equilibrium at a fraction of the loading, f(u) - b - sum_q p_q n_q (N, 3) [N].

        Contact forces p >= 0 at touching points are those that leave the least of it on free components (a non-negative least-squares
        problem); a point touches when its gap is below TOUCHING cell sizes. With it the reactions (K, 3) [N] of the body on each obstacle.
        """
        outer = self.apply_loads(fraction)  # first: from then on pressures follow their faces as there
        force = self.elasticity.force(u) - outer
        if self.contact is None:
            return force, np.zeros((0, 3))
        reactions, centre = np.zeros((len(self.contact.obstacle.each), 3)), self.contact.obstacle.position(fraction)
        zone = self.contact.zone(u, centre, TOUCHING * self.size)
        if len(zone.points) and np.isfinite(force).all():
            _, normal = zone.gaps(u, centre)
            movable = ~self.fixed[zone.nodes]  # (m, 3)
            points, nodes = np.arange(len(zone.points)), np.arange(len(zone.nodes))
            pull = zone.gradient(points, nodes, normal)[:, movable.ravel()].T  # (3 m, q)
            p = scipy.optimize.nnls(pull, force[zone.nodes][movable], maxiter=100 * len(points))[0]
            force[zone.nodes] -= zone.forces(p, normal)
            reactions = -zone.obstacle.sums(p, normal)
        return force, reactions

    def turned(self, u: Floats, at: Floats) -> bool:
        """Whether a factor made at one place (N, 3) no longer serves at another, as some node moved by TURNED of the extent h.

        Where the end of a slender body has moved by d across it, a step along its soft directions is off by about 10 (d/h)^2 of
        itself: the axial stiffness E h^2 / L has turned by 1.5 d/L against the bending stiffness E h^4 / (4 L^3).
        """
        return float(np.linalg.norm(u - at, axis=1).max()) > TURNED * self.thin

    def stride(self, start: float, end: float) -> float:
        """How far the obstacle moves between two fractions of the loading, over what is safe for one step; of several the farthest."""
        return max(self._strides(start, end), default=0.0)

    def _strides(self, start: float, end: float) -> list[float]:
        """That of each obstacle.

        An obstacle that moves by half of its own width, or of the body's, could pass through without touching at either end.
        """
        strides = []
        for obstacle in self.contact.obstacle.each if self.contact is not None else ():
            corners = obstacle.reached[bisect_right(obstacle.reached, start):bisect_left(obstacle.reached, end)]
            way = [obstacle.position(fraction) for fraction in (start, *corners, end)]
            safe = min(obstacle.width, self.thin) / 2
            strides.append(sum(map(math.dist, way, way[1:])) / safe)
        return strides

    def _check(self) -> None:
        if not self.scene.steps.dynamic and (self.contact is not None or self.loaded):
            if free := loose(self.mesh, self.fixed):
                raise InputError(f"support: {free}")
        if self.fixed.all():
            raise InputError("support: every node of the body is held in every direction, so nothing is left to move; hold less of it")
        extent, modulus = float(np.ptp(self.mesh.points, axis=0).max()), self.scene.stiffest
        densest = max(material.density for material in self.scene.materials)
        for i, load in enumerate(() if self.scene.linear else self.scene.load):
            push = load.traction or (load.pressure or 0.0, *(densest * extent * a for a in load.acceleration or ()))
            strength = float(np.linalg.norm(push)) * largest_share(load)
            if strength > STRONGEST * modulus:
                raise InputError(f"load[{i}]: {strength:.2g} Pa are {strength / modulus:.2g} times Young's modulus; at most "
                                 f"{STRONGEST:g} times")
        strides, allowed = self._strides(0.0, 1.0), max(FARTHEST, self.scene.steps.count)
        far = max(strides, default=0.0)
        if far > allowed:
            raise InputError(f"{self._named(strides.index(far))}.path: its length is {far:.2g} times what the obstacle may move at once "
                             f"(half of its own width or of the body's); at most {allowed:g} times, or as many as there are steps")
        for which, rigid in enumerate(self.contact.obstacle.each if self.contact is not None else ()):
            if buried(rigid, self.mesh):
                raise InputError(f"{self._named(which)}.path: the obstacle starts wholly inside the body; start it outside")
        inside = -self.clearance(0.0)
        if self.contact is not None and inside > GAP_TOLERANCE * self.size:
            points = self.contact.surface.positions(self.mesh.points)
            which = int(np.argmin([rigid.gap(points, rigid.position(0.0))[0].min() for rigid in self.contact.obstacle.each]))
            raise InputError(f"{self._named(which)}.path: the obstacle starts {inside:.3g} m inside the body; start it outside")

    def _named(self, obstacle: int) -> str:
        """An obstacle by its number, as it stands in the scene file."""
        return f"obstacle[{obstacle}]" if isinstance(self.scene.obstacle, tuple) else "obstacle"


def cells_said(scene: Scene) -> str:
    """What a body is meshed with, in words."""
    element = "" if scene.body.element == "standard" else f", {scene.body.element} element"
    if is_plane(scene.body):
        element += f", plane {scene.body.plane or 'strain'}, {scene.body.thickness or 1.0:g} m thick"
    cells = "the cells of the file" if scene.body.shape == "file" else CELLS[scene.body.cell].plural
    return f"{cells}, of {'second' if scene.body.order == 2 else 'first'} order{element}"


def material_said(scene: Scene) -> str:
    """The laws of a body, of several materials with where they are, and its cells, in words."""
    places = [f" ({material.where or 'elsewhere'})" * (len(scene.materials) > 1) for material in scene.materials]
    return f"{', '.join(material.law + place for material, place in zip(scene.materials, places, strict=True))}; {cells_said(scene)}"


def contact_said(scene: Scene) -> str:
    """How contact is treated, in words."""
    if not scene.obstacles:
        return "none: the scene has no obstacle"
    points = {"facets": "points of the surface facets", "smooth": "points of the surface made smooth", "nodes": "surface nodes"}
    said = [f"{'frictionless ' * (not i)}at {points[one.contact]}, rigid {one.shape}{f' ({one.source})' if one.source else ''}"
            + " with sharp edges, on which the surface may catch where they slide over it: give it a radius" * (one.radius == 0)
            for i, one in enumerate(scene.obstacles)]
    return f"{'; '.join(said)}; nothing is solved before {'it' if len(said) == 1 else 'one'} touches"


def could_be_plane(balance: Balance) -> dict[str, str]:
    """A word on a solid body that is a slice one cell thick and held across: a plane one would do."""
    mesh = balance.mesh
    for axis in range(mesh.dimension if mesh.dimension == 3 else 0):
        levels = np.unique(mesh.points[:, axis].round(12))
        if len(levels) == 2 and balance.fixed[:, axis].all() and not balance.moves.at(1.0)[:, axis].any():
            return {"plane": f"the body is one cell thick along {'xyz'[axis]} and held across: as a plane body (plane = \"strain\", "
                             f"thickness = {np.ptp(levels):g}) it has half as many unknowns"}
    return {}

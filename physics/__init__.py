"""Finite elements: what a body does under loads and rigid obstacles, how it vibrates, and how good a prediction of either is.

A room imports what stands above it in this list, never below:

    schema, whole   a user's table read and checked; a file written whole or not at all
    foreign         a file as meshio reads it, or why it does not
    threads         one for the linear algebra
    journal         an unfinished path on disk, to go on from after a kill
    scene/          what is simulated: body, material, supports, loads, obstacle, steps
    keys            the keys of a scene as tables for the docs
    mesh/           what the body's mesh is, where its places are, whether it is sound
    fem             the only file that knows which dolfinx is installed
    linalg/         how K x = b and K x = lambda M x are solved
    body/           what energy and forces a deformed body has
    contact/        where the obstacle is, its shapes, and the contact condition
    equilibrium/    one equilibrium, and a path of them; when a factor is renewed
    modes/          how a body vibrates
    motion/         a body in motion, with inertia
    reduced/        the same body in a few shapes
    flow/           a fluid that flows through a plane domain
    solution        `solve`: the answer to a scene, through equilibria or through time
    accuracy/       an error that is asked for: the cheapest mesh that keeps it, and how far that may be believed
    fidelity/       how good a prediction is, and what a Newton step makes of it
    view/           how it looks

What a user calls is importable from here: `from physics import load_scene, solve, elastic_modes, verify`. It is loaded when it
is asked for, so that `import physics` costs nothing and what learns from data runs without dolfinx. It sets one thread for the
linear algebra where the environment names no number (threads.py).
"""

from importlib import import_module
from typing import Any

from physics.threads import one_thread

one_thread()

_PUBLIC = {
    "Body": "scene", "InputError": "schema", "Load": "scene", "Material": "scene", "Mesh": "mesh.mesh",
    "NoEquilibrium": "equilibrium.state", "Obstacle": "scene", "Scene": "scene", "Solution": "solution", "Steps": "scene",
    "Support": "scene", "Where": "scene", "build_mesh": "mesh.build", "elastic_modes": "modes.elastic", "film": "view",
    "FlowScene": "scene", "FlowSolution": "flow.solution",
    "laplacian_modes": "modes.laplacian", "load_body": "scene", "load_scene": "scene", "read_mesh": "mesh.files", "read_any": "scene",
    "read_scene": "scene",
    "solve": "solution", "solve_flow": "flow.solution", "verify": "fidelity.verify", "von_mises": "body.stress", "write_mesh": "mesh.files",
}
__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'physics' has no attribute {name!r}")
    return getattr(import_module(f"physics.{_PUBLIC[name]}"), name)

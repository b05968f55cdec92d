"""A part of your own, from a gmsh file, pressed by a sphere: the work of the sphere is what the part stores.

gmsh or a CAD program would write the file; here meshio does, so that the example needs neither: an L-shaped bracket of
hexahedra with two physical groups, "foot" (a surface) and "bracket" (the volume). The groups are the places that a
scene may name.
"""

import meshio
import numpy as np

from physics import read_mesh, read_scene, solve

SIZE = 0.005  # [m] of a cell
columns = [(i, k) for i in range(8) for k in range(8) if i < 2 or k < 2]  # an L in the x-z plane
cubes = [(i, j, k) for i, k in columns for j in range(3)]
corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
nodes = sorted({tuple(np.add(cube, corner)) for cube in cubes for corner in corners})
number = {node: i for i, node in enumerate(nodes)}
cells = [[number[tuple(np.add(cube, corner))] for corner in corners] for cube in cubes]
foot = [cell[:4] for cube, cell in zip(cubes, cells, strict=True) if cube[2] == 0]
meshio.write("bracket.msh", meshio.Mesh(
    SIZE * np.array(nodes, float), [("quad", foot), ("hexahedron", cells)],
    cell_data={name: [np.full(len(foot), 1), np.full(len(cells), 2)] for name in ("gmsh:physical", "gmsh:geometrical")},
    field_data={"foot": np.array([1, 2]), "bracket": np.array([2, 3])}), file_format="gmsh22", binary=False)
print(f"{len(read_mesh('bracket.msh').cells)} cells, places {', '.join(read_mesh('bracket.msh').places)}")

path = np.array([[-0.0102, 0.0075, 0.035], [-0.0052, 0.0075, 0.035]])  # [m] the centre, from outside into the upright side
scene = read_scene({
    "body": {"shape": "file", "path": "bracket.msh"}, "material": {"young_modulus": 1e6, "poisson_ratio": 0.3},
    "support": [{"where": "foot"}], "obstacle": {"shape": "sphere", "radius": 0.01, "path": path.tolist()}, "steps": {"count": 40}})
solution = solve(scene)

push = -solution.reaction[:, 0]  # [N] of the sphere on the part
work = ((push[1:] + push[:-1]) / 2).sum() * np.ptp(path[:, 0]) / 40  # [J]
print(f"work of the sphere {1e6 * work:.3f} uJ, stored {1e6 * solution.energy[-1]:.3f} uJ")
assert abs(work / solution.energy[-1] - 1) < 0.01

""".xdmf files of several grids, as dolfinx writes a mesh and its tags: one grid of cells, and one of tagged entities for each MeshTags.

The numbers of a grid's tags name its groups; where tags of two names have the same number, with their names: "walls-1", "loads-1".
Light data are XML, heavy data HDF5 beside it; nodes are in VTK's order. The grids share the nodes of the first one, which the others
include by an XPointer.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS
from physics.mesh.formats.raw import Raw, block
from physics.schema import InputError

Integers = NDArray[np.int64]
KINDS = {"polyvertex": ("vertex", 1), "polyline": ("line", 2), "triangle": ("triangle", 3), "quadrilateral": ("quadrilateral", 4),
         "tetrahedron": ("tetrahedron", 4), "wedge": ("prism", 6), "hexahedron": ("hexahedron", 8), "edge_3": ("line", 3),
         "triangle_6": ("triangle", 6), "tri_6": ("triangle", 6), "quadrilateral_8": ("quadrilateral", 8), "quad_8": ("quadrilateral", 8),
         "quadrilateral_9": ("quadrilateral", 9), "quad_9": ("quadrilateral", 9), "tetrahedron_10": ("tetrahedron", 10),
         "tet_10": ("tetrahedron", 10), "hexahedron_20": ("hexahedron", 20), "hex_20": ("hexahedron", 20),
         "hexahedron_27": ("hexahedron", 27), "hex_27": ("hexahedron", 27)}


def grids(path: Path) -> list[ElementTree.Element]:
    """The grids with cells of their own in a file. Raises ParseError when it is not XML."""
    return [grid for grid in ElementTree.parse(path).getroot().iter("Grid") if grid.find("Topology") is not None]


def read(path: Path) -> Raw:
    """A file of several grids. Raises `InputError`, or what h5py and numpy raise, for what is not one."""
    points, blocks = None, []
    tagged: dict[tuple[str, int], dict[str, list[tuple[int, Integers]]]] = {}  # number and dimension to name to cells
    for grid in grids(path):
        geometry = grid.find("Geometry")
        item = None if geometry is None else geometry.find("DataItem")
        if item is not None:
            found = np.asarray(_data(path, item), np.float64)
            if points is not None and not np.array_equal(points, found):
                raise InputError("its grids have different nodes: give the body alone")
            points = found
        topology = grid.find("Topology")
        assert topology is not None
        name = topology.get("TopologyType", topology.get("Type", "")).lower()
        if name not in KINDS:
            raise InputError(f"a grid of {name or 'unknown'} cells, which is not known here")
        kind, size = KINDS[name]
        data = topology.find("DataItem")
        if data is None:
            raise InputError("a grid without cells")
        blocks.append(block(kind, np.asarray(_data(path, data), np.int64).reshape(-1, size)))
        for attribute in grid.findall("Attribute"):
            values = attribute.find("DataItem")
            if attribute.get("Center") != "Cell" or values is None:
                continue
            tags = np.asarray(_data(path, values)).ravel()
            if len(tags) != len(blocks[-1].nodes) or not np.array_equal(tags, np.rint(tags)):
                continue  # a field, and no tags
            for tag in np.unique(tags):
                of = tagged.setdefault((f"{int(tag)}", CELLS[kind].dimension), {})
                of.setdefault(attribute.get("Name", "tags"), []).append((len(blocks) - 1, np.flatnonzero(tags == tag)))
    if points is None:
        raise InputError("no grid with nodes of its own")
    groups = {(number if len(names) == 1 else f"{name}-{number}", dimension): members
              for (number, dimension), names in tagged.items() for name, members in names.items()}
    return Raw(points, blocks, groups)


def _data(path: Path, item: ElementTree.Element) -> NDArray[np.generic]:
    """The numbers of a DataItem, in its shape."""
    shape = tuple(int(n) for n in item.get("Dimensions", "").split())
    text = (item.text or "").strip()
    if item.get("Format", "XML") == "XML":
        return np.array(text.split(), np.float64).reshape(shape)
    if item.get("Format") != "HDF":
        raise InputError(f"data of format {item.get('Format')}, which is not known here")
    import h5py

    name, _, inside = text.partition(":")
    with h5py.File(path.parent / name, "r") as file:
        return np.asarray(file[inside][()]).reshape(shape)

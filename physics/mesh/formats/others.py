"""Whatever else meshio reads. What its readers keep of groups has another name in each format.

Numbers on cells (physical groups, references, property numbers, materials) name groups; MED's families are sets of groups, whose
names they give, of cells and of nodes; voxels and pixels, which VTK lists row by row, become hexahedra and quadrilaterals.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.foreign import read_foreign
from physics.mesh.cell import CELLS, OF_MESHIO
from physics.mesh.formats.raw import CellBlock, Raw, block

Integers = NDArray[np.int64]
TAGS = ("gmsh:physical", "medit:ref", "avsucd:material", "ugrid:ref", "netgen:index", "tetgen:ref", "CellEntityIds")
LAGRANGE = {"VTK_LAGRANGE_CURVE": "line", "VTK_LAGRANGE_TRIANGLE": "triangle", "VTK_LAGRANGE_QUADRILATERAL": "quad",
            "VTK_LAGRANGE_TETRAHEDRON": "tetra", "VTK_LAGRANGE_HEXAHEDRON": "hexahedron", "VTK_LAGRANGE_WEDGE": "wedge"}
ROUND = ("quadrilateral", "hexahedron")  # whose further nodes have had two orders in VTK
ROW_BY_ROW = {"pixel": ("quad", [0, 1, 3, 2]), "voxel": ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6])}


def read(path: Path) -> Raw:
    """Any file that meshio reads. Raises `InputError` with meshio's own reason for one that it does not."""
    _know_voxels()
    _know_letters()
    return of_meshio(read_foreign(path))


def of_meshio(found: Any) -> Raw:
    """What a mesh of meshio's says."""
    blocks: list[CellBlock] = []
    labels = getattr(found, "cells_id", None) or [None] * len(found.cells)
    for cells, label in zip(found.cells, labels, strict=False):
        name, data = cells.type, cells.data
        if name in ROW_BY_ROW:
            name, order = ROW_BY_ROW[name]
            data = np.asarray(data)[:, order]
        known = OF_MESHIO.get(LAGRANGE.get(name) or name.rstrip("0123456789"))
        kind = name if known is None else known.name
        blocks.append(block(kind, np.asarray(data, np.int64), label, () if kind in ROUND and name in LAGRANGE else None))
    groups: dict[tuple[str, int], list[tuple[int, Integers]]] = {}
    names = {(int(tag), int(dim)): name for name, (tag, dim) in _pairs(found.field_data)}
    for key in TAGS:
        for number, tags in enumerate(found.cell_data.get(key, [])[:len(blocks)]):
            tags, dimension = np.asarray(tags).ravel(), CELLS[blocks[number].kind].dimension
            for tag in np.unique(tags[tags > 0] if key == "CellEntityIds" else tags[tags != 0]):
                name = names.get((int(tag), dimension), f"{int(tag)}")
                groups.setdefault((name, dimension), []).append((number, np.flatnonzero(tags == tag)))
    for name, members in found.cell_sets.items():
        if not name.startswith("gmsh:"):
            kept = [(number, np.asarray(rows, np.int64)) for number, rows in enumerate(members[:len(blocks)])
                    if rows is not None and len(rows)]
            if kept:
                groups[name, max(CELLS[blocks[number].kind].dimension for number, _ in kept)] = kept
    for number, families in enumerate(found.cell_data.get("cell_tags", [])[:len(blocks)]):
        for family, belongs in getattr(found, "cell_tags", {}).items():
            rows = np.flatnonzero(np.asarray(families).ravel() == family)
            for name in belongs if len(rows) else ():
                groups.setdefault((name, CELLS[blocks[number].kind].dimension), []).append((number, rows))
    node_sets = {name: np.asarray(nodes, np.int64).ravel() for name, nodes in found.point_sets.items()}
    families = np.asarray(found.point_data.get("point_tags", [])).ravel()
    for family, belongs in getattr(found, "point_tags", {}).items():
        for name in belongs:
            node_sets[name] = np.concatenate([node_sets.get(name, np.empty(0, np.int64)), np.flatnonzero(families == family)])
    return Raw(np.asarray(found.points, np.float64), blocks, groups, node_sets)


def _pairs(field_data: dict[str, Any]) -> list[tuple[str, Any]]:
    """The entries of meshio's field_data that are (tag, dimension), as gmsh's are."""
    return [(name, np.ravel(value)) for name, value in field_data.items() if np.size(value) == 2]


def _know_voxels() -> None:
    """Tell meshio of voxels, which its table of VTK's cells leaves out."""
    from meshio import _common, _mesh, _vtk_common
    from meshio.vtk import _vtk_42

    for number, (name, size, dimension) in {8: ("pixel", 4, 2), 11: ("voxel", 8, 3)}.items():
        _vtk_common.vtk_to_meshio_type.setdefault(number, name)
        _common.num_nodes_per_cell.setdefault(name, size)
        _mesh.topological_dimension.setdefault(name, dimension)
        _vtk_42.vtk_type_to_numnodes[number] = size


def _know_letters() -> None:
    """Tell meshio that names in MED files are text in UTF-8: it takes each byte for a letter, and stumbles over those above 127."""
    from meshio.med import _med

    def families(found: Any) -> dict[int, list[str]]:
        return {part.attrs["NUM"]: [np.asarray(name, np.int8).tobytes().decode(errors="replace").strip().rstrip("\x00")
                                    for name in part["GRO"]["NOM"][()][:part["GRO"].attrs["NBR"]]] for part in found.values()}

    _med._read_families = families

"""SU2's .su2 files: cells by VTK's numbers, and markers on the boundary, which have names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS
from physics.mesh.formats.raw import Raw, block
from physics.schema import InputError

Integers = NDArray[np.int64]
OF_VTK = {cell.vtk: cell for cell in CELLS.values() if not cell.middles}


def read(path: Path) -> Raw:
    """An .su2 file. Raises `InputError`, or ValueError, for what is not one."""
    lines = [line.split("%")[0].strip() for line in path.read_text(errors="replace").splitlines()]
    lines = [line for line in lines if line]
    dimension, marker = 3, ""
    points = np.empty((0, 3))
    tables: dict[str, list[tuple[str, list[int]]]] = {}  # kind to marker and nodes
    at = 0
    while at < len(lines):
        key, equals, value = (word.strip() for word in lines[at].partition("="))
        at += 1
        if not equals:
            continue
        if key == "NDIME":
            dimension = int(value)
        elif key == "MARKER_TAG":
            marker = value
        elif key == "NPOIN":
            rows = _rows(lines, at, int(value.split()[0]))
            points = np.array([row.split()[:dimension] for row in rows], np.float64).reshape(-1, dimension)
            at += len(rows)
        elif key in ("NELEM", "MARKER_ELEMS"):
            rows = _rows(lines, at, int(value))
            at += len(rows)
            for row in rows:
                number, *nodes = (int(word) for word in row.split())
                cell = OF_VTK.get(number)
                if cell is None:
                    raise InputError(f"has cells of VTK's type {number}, which is not known here")
                if len(nodes) < cell.corners:
                    raise InputError(f"a {cell.name} has {len(nodes)} nodes: {row}")
                tables.setdefault(cell.name, []).append((marker if key == "MARKER_ELEMS" else "", nodes[:cell.corners]))
    groups: dict[tuple[str, int], list[tuple[int, Integers]]] = {}
    blocks = []
    for number, (kind, entries) in enumerate(tables.items()):
        blocks.append(block(kind, np.array([nodes for _, nodes in entries], np.int64)))
        for name in dict.fromkeys(name for name, _ in entries if name):
            rows_of = np.array([i for i, (other, _) in enumerate(entries) if other == name], np.int64)
            groups.setdefault((name, CELLS[kind].dimension), []).append((number, rows_of))
    return Raw(points, blocks, groups)


def _rows(lines: list[str], at: int, count: int) -> list[str]:
    if count < 0 or at + count > len(lines):
        raise InputError("a section is shorter than it says")
    return lines[at:at + count]

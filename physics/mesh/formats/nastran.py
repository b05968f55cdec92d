"""Nastran's bulk data (.bdf, .nas, .fem): grid points and cells, in fields of 8 or 16 characters or between commas.

The property number of a cell names its group, a SET of SPC1 cards its nodes: "spc-3". Cards of other kinds are passed over; grid
points in a coordinate system of their own are refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, Corners
from physics.mesh.formats.raw import VTK_MIDDLES, Raw, block, numbered
from physics.schema import InputError

Integers = NDArray[np.int64]

CARDS = {"CTETRA": ("tetrahedron", (4, 10)), "CPENTA": ("prism", (6, 15)), "CHEXA": ("hexahedron", (8, 20)), "CTRIA3": ("triangle", (3,)),
         "CTRIAR": ("triangle", (3,)), "CTRIA6": ("triangle", (3, 6)), "CQUAD4": ("quadrilateral", (4,)), "CQUADR": ("quadrilateral", (4,)),
         "CSHEAR": ("quadrilateral", (4,)), "CQUAD8": ("quadrilateral", (4, 8)), "CBAR": ("line", (2,)), "CBEAM": ("line", (2,)),
         "CROD": ("line", (2,)), "CPYRAM": ("pyramid", (5,)), "CPYRA": ("pyramid", (5,))}
_EDGES = CELLS["hexahedron"].edges
MIDDLES: dict[str, Corners] = VTK_MIDDLES | {"hexahedron": (*_EDGES[:4], *_EDGES[8:], *_EDGES[4:8])}  # bottom, upright, top


def read(path: Path) -> Raw:
    """A file of bulk data. Raises `InputError`, or ValueError, for what is not one."""
    labels, points = [], []
    tables: dict[tuple[str, int], list[tuple[int, int, list[int]]]] = {}  # kind, nodes each: label, property, nodes
    held: dict[str, list[list[int]]] = {}  # first and last
    for name, fields in _cards(path):
        if name == "GRID":
            if fields[1:2] and fields[1] not in ("", "0"):
                raise InputError(f"grid point {fields[0]} is in coordinate system {fields[1]}: export it in the basic one")
            labels.append(int(fields[0]))
            points.append([_number(field) for field in (*fields[2:5], "", "", "")[:3]])
        elif name in CARDS:
            kind, sizes = CARDS[name]
            words = [word for word in fields[2:2 + sizes[-1]] if word not in ("", "0")]
            size = sizes[-1] if len(words) == sizes[-1] else sizes[0]  # some middle nodes may be left out: then all are
            words = fields[2:2 + size]
            if len(words) < size or "" in words:
                raise InputError(f"cell {fields[0]}: a {name} has {len(words)} nodes")
            tables.setdefault((kind, size), []).append((int(fields[0]), int(fields[1] or 0), [int(word) for word in words]))
        elif name == "SPC1":
            words = fields[2:]
            through = [int(words[0]), int(words[2])] if words[1:2] and words[1].upper() == "THRU" else []
            held.setdefault(f"spc-{fields[0]}", []).extend([through] if through else [[int(word)] * 2 for word in words if word])
    known = np.array(labels, np.int64)
    blocks, groups = [], dict[tuple[str, int], list[tuple[int, Integers]]]()
    for number, ((kind, _), rows) in enumerate(tables.items()):
        cells = numbered(known, np.array([row[2] for row in rows], np.int64))
        blocks.append(block(kind, cells, np.array([row[0] for row in rows], np.int64), MIDDLES.get(kind)))
        owner = np.array([row[1] for row in rows])
        for tag in np.unique(owner[owner != 0]):
            groups.setdefault((f"{tag}", CELLS[kind].dimension), []).append((number, np.flatnonzero(owner == tag)))
    node_sets = {name: np.flatnonzero(np.any([(known >= first) & (known <= last) for first, last in rows], axis=0))
                 for name, rows in held.items()}
    return Raw(np.array(points, np.float64).reshape(-1, 3), blocks, groups, node_sets, known)


def _cards(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Each card's name and its fields, those of its continuations too."""
    name, fields = "", list[str]()
    lines = path.read_text(errors="replace").splitlines()
    start = next((i + 1 for i, line in enumerate(lines) if line.strip().upper().startswith("BEGIN BULK")), 0)
    for line in lines[start:]:
        line = line.split("$")[0].rstrip()
        if not line:
            continue
        if line.strip().upper().startswith("ENDDATA"):
            break
        if "," in line:
            words = [word.strip() for word in line.split(",")][:9]
        else:
            line = line.expandtabs(8)
            width = 16 if "*" in line[:8] else 8
            words = [line[:8].strip(), *(line[at:at + width].strip() for at in range(8, min(len(line), 72), width))]
            words += [""] * (1 + 64 // width - len(words))
        if words[0] == "" or words[0][0] in "+*":
            fields += words[1:]
        else:
            if name:
                yield name, fields
            name, fields = words[0].rstrip("*").strip().upper(), words[1:]
    if name:
        yield name, fields


def _number(text: str) -> float:
    """Nastran's reals may lack the letter: 1.5-3 is 1.5e-3."""
    return float(re.sub(r"(?<=[\d.])([+-]\d+)$", r"e\1", text.upper().replace("D", "E"))) if text else 0.0

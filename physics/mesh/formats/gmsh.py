"""Gmsh's .msh files, versions 2.2, 4.0 and 4.1, text and binary, with all physical groups of every geometric entity.

As in the section "File formats" of gmsh's manual. Which groups a cell is in is told by the cell itself in version 2.2, which
lists a cell once for each of them, and by the entity that it lies on in version 4; a file saved whole has cells in no group too.
"""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, Corners
from physics.mesh.formats.raw import VTK_MIDDLES, CellBlock, Raw, block, numbered
from physics.schema import InputError

Integers = NDArray[np.int64]

# gmsh's number of a type to our kind and its number of nodes.
TYPES = {1: ("line", 2), 2: ("triangle", 3), 3: ("quadrilateral", 4), 4: ("tetrahedron", 4), 5: ("hexahedron", 8), 6: ("prism", 6),
         7: ("pyramid", 5), 8: ("line", 3), 9: ("triangle", 6), 10: ("quadrilateral", 9), 11: ("tetrahedron", 10),
         12: ("hexahedron", 27), 13: ("prism", 18), 14: ("pyramid", 14), 15: ("vertex", 1), 16: ("quadrilateral", 8),
         17: ("hexahedron", 20), 18: ("prism", 15), 19: ("pyramid", 13), 20: ("triangle", 9), 21: ("triangle", 10), 26: ("line", 4),
         27: ("line", 5), 29: ("tetrahedron", 20), 30: ("tetrahedron", 35), 36: ("quadrilateral", 16), 92: ("hexahedron", 64)}
MIDDLES: dict[str, Corners] = VTK_MIDDLES | {
    "tetrahedron": ((0, 1), (1, 2), (2, 0), (0, 3), (2, 3), (1, 3)),
    "hexahedron": ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7), (0, 3, 2, 1),
                   (0, 1, 5, 4), (0, 3, 7, 4), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7), tuple(range(8)))}
RUN = 4096  # so many cells of one type are looked at together


class Numbers:
    """The numbers of one section, in order, from text or from bytes."""

    def __init__(self, data: bytes, at: int, *, binary: bool, end: bytes, size: str, order: str) -> None:
        self.data, self.words, self.at, self.binary, self.order, self.size = data, list[bytes](), at, binary, order, size
        if not binary:
            stop = data.find(end, at)
            if stop < 0:
                raise InputError(f"{end.decode()} is missing: the file was cut off")
            self.words, self.at = data[at:stop].split(), 0

    def take(self, kind: str, count: int) -> NDArray[Any]:
        """The next ones: kind i of 4 bytes, d of 8, s of a size."""
        if count < 0:
            raise InputError("a negative number of entries")
        if not self.binary:
            part = self.words[self.at:self.at + count]
            self.at += count
            if len(part) < count:
                raise InputError("a section is shorter than it says")
            return np.array(part, np.float64 if kind == "d" else np.int64)
        code = np.dtype(self.order + {"i": "i4", "d": "f8", "s": self.size}[kind])
        if self.at + count * code.itemsize > len(self.data):
            raise InputError("a section is shorter than it says")
        found = np.frombuffer(self.data, code, count, self.at)
        self.at += count * code.itemsize
        return found.astype(np.float64 if kind == "d" else np.int64)

    def labelled(self, count: int, width: int) -> tuple[Integers, NDArray[np.float64]]:
        """Rows of a label and some coordinates: (count,) and (count, width)."""
        if not self.binary:
            table = self.take("d", (1 + width) * count).reshape(count, 1 + width)
            return table[:, 0].astype(np.int64), table[:, 1:]
        kind = np.dtype([("label", self.order + "i4"), ("x", self.order + "f8", (width,))])
        if count < 0 or self.at + count * kind.itemsize > len(self.data):
            raise InputError("a section is shorter than it says")
        rows = np.frombuffer(self.data, kind, count, self.at)
        self.at += count * kind.itemsize
        return rows["label"].astype(np.int64), rows["x"].astype(np.float64)

    def one(self, kind: str) -> int:
        """The next one as an integer."""
        return int(self.take(kind, 1)[0])


def read(path: Path) -> Raw:
    """A .msh file of gmsh's. Raises `InputError`, or ValueError, for what is not one."""
    data = path.read_bytes()
    start = data.index(b"$MeshFormat")
    words = data[start:start + 200].split(b"\n", 2)[1].split()
    version, binary, size = words[0].decode(), int(words[1]) == 1, int(words[2])
    if version not in ("2", "2.0", "2.1", "2.2", "4", "4.0", "4.1"):
        raise InputError(f"a .msh file of version {version}; known are 2.2, 4.0 and 4.1")
    order = "<" if not binary or b"\x01\x00\x00\x00" in data[start:start + 60] else ">"
    new = version == "4.1"

    def section(name: str) -> Numbers | None:
        key = b"$" + name.encode()
        at = data.find(b"\n" + key)
        if at < 0:
            return None
        at = data.index(b"\n", at + 1) + 1
        return Numbers(data, at, binary=binary, end=b"$End" + name.encode(), order=order, size=f"u{size}" if new else "u8")

    nodes, elements, entities = section("Nodes"), section("Elements"), section("Entities")
    if nodes is None or elements is None:
        raise InputError(f"no ${'Nodes' if nodes is None else 'Elements'} in it")
    if version[0] == "2":
        labels, points = _nodes_2(nodes)
        blocks, tags = _elements_2(elements)
    else:
        groups_of = {} if entities is None else _entities(entities, new)
        if (parts := section("PartitionedEntities")) is not None and new:
            groups_of |= _partitioned(parts)
        labels, points = _nodes_4(nodes, new)
        blocks, tags = _elements_4(elements, groups_of, new)
    blocks = [block(b.kind, numbered(labels, b.nodes), b.labels, MIDDLES.get(b.kind)) for b in blocks]
    names = _names(data)
    groups: dict[tuple[str, int], list[tuple[int, Integers]]] = {}
    for number, of_block in enumerate(tags):
        dimension = CELLS[blocks[number].kind].dimension
        for tag, rows in of_block.items():
            groups.setdefault((names.get((dimension, tag), str(tag)), dimension), []).append((number, rows))
    for (dimension, _), name in names.items():
        groups.setdefault((name, dimension), [])  # version 2.2 saved whole keeps names and forgets who is in them
    return Raw(points, blocks, groups, labels=labels)


def _names(data: bytes) -> dict[tuple[int, int], str]:
    """The names of physical groups, by dimension and number."""
    start = data.find(b"$PhysicalNames")
    if start < 0:
        return {}
    names = {}
    for line in data[start:data.find(b"$EndPhysicalNames", start)].decode(errors="replace").splitlines()[2:]:
        words = shlex.split(line)
        if len(words) >= 3:
            names[int(words[0]), int(words[1])] = words[2]
    return names


def _nodes_2(numbers: Numbers) -> tuple[Integers, NDArray[np.float64]]:
    return numbers.labelled(_line(numbers) if numbers.binary else numbers.one("i"), 3)


def _line(numbers: Numbers) -> int:
    """A number written out on a line of its own in a binary file."""
    end = numbers.data.index(b"\n", numbers.at)
    count = int(numbers.data[numbers.at:end])
    numbers.at = end + 1
    return count


def _elements_2(numbers: Numbers) -> tuple[list[CellBlock], list[dict[int, Integers]]]:
    """The cells by type, and for each type which are in which physical group."""
    tables: dict[int, list[Integers]] = {}  # label, physical group, nodes
    count, done = (_line(numbers) if numbers.binary else numbers.one("i")), 0
    text = None if numbers.binary else numbers.take("i", len(numbers.words) - numbers.at).astype(np.int64)
    at = 0
    while done < count:
        if text is None:
            kind, many, tags = (int(n) for n in numbers.take("i", 3))
            table = numbers.take("i", many * (1 + tags + _size(kind))).reshape(many, -1).astype(np.int64)
        else:
            if len(text) < at + 3:
                raise InputError("a section is shorter than it says")
            kind, tags = int(text[at + 1]), int(text[at + 2])
            stride = 3 + tags + _size(kind)
            rows = text[at:at + stride * (min(len(text) - at, RUN * stride) // stride)].reshape(-1, stride)
            alike = (rows[:, 1] == kind) & (rows[:, 2] == tags)
            many = min(count - done, len(rows) if alike.all() else int(np.argmin(alike)))
            table = np.delete(rows[:many], (1, 2), axis=1)
            at += many * stride
        if many < 1 or tags < 0:
            raise InputError("a section is shorter than it says")
        physical = table[:, 1:2] if tags else np.zeros((many, 1), np.int64)
        tables.setdefault(kind, []).append(np.concatenate([table[:, :1], physical, table[:, 1 + tags:]], axis=1))
        done += many
    blocks, groups = [], []
    for kind, parts in tables.items():
        table = np.concatenate(parts)
        blocks.append(CellBlock(TYPES[kind][0], table[:, 2:], table[:, 0]))
        physical = abs(table[:, 1])
        groups.append({int(tag): np.flatnonzero(physical == tag) for tag in np.unique(physical[physical != 0])})
    return blocks, groups


def _size(kind: int) -> int:
    if kind not in TYPES:
        raise InputError(f"has cells of gmsh's type {kind}, which is not known here")
    return TYPES[kind][1]


def _entities(numbers: Numbers, new: bool) -> dict[tuple[int, int], Integers]:
    """The physical groups of each geometric entity, by dimension and number."""
    found = {}
    for dimension, count in enumerate(numbers.take("s", 4)):
        for _ in range(int(count)):
            tag = numbers.one("i")
            numbers.take("d", 3 if dimension == 0 and new else 6)
            found[dimension, tag] = abs(numbers.take("i", numbers.one("s")).astype(np.int64))
            if dimension:
                numbers.take("i", numbers.one("s"))
    return found


def _partitioned(numbers: Numbers) -> dict[tuple[int, int], Integers]:
    """The same of a mesh that gmsh has cut for several processes."""
    found = {}
    numbers.one("s")
    numbers.take("i", 2 * numbers.one("s"))
    for dimension, count in enumerate(numbers.take("s", 4)):
        for _ in range(int(count)):
            tag = int(numbers.take("i", 3)[0])
            numbers.take("i", numbers.one("s"))
            numbers.take("d", 6 if dimension else 3)
            found[dimension, tag] = abs(numbers.take("i", numbers.one("s")).astype(np.int64))
            if dimension:
                numbers.take("i", numbers.one("s"))
    return found


def _nodes_4(numbers: Numbers, new: bool) -> tuple[Integers, NDArray[np.float64]]:
    blocks = int(numbers.take("s", 4 if new else 2)[0])
    labels, points = [np.empty(0, np.int64)], [np.empty((0, 3))]
    for _ in range(blocks):
        first, second, parametric = (int(n) for n in numbers.take("i", 3))
        count = numbers.one("s")
        width = 3 + ((first if new else second) if parametric else 0)  # a place on the entity follows
        if new:
            labels.append(numbers.take("s", count).astype(np.int64))
            points.append(numbers.take("d", width * count).reshape(count, width)[:, :3])
        else:
            label, place = numbers.labelled(count, width)
            labels.append(label)
            points.append(place[:, :3])
    return np.concatenate(labels), np.concatenate(points)


def _elements_4(numbers: Numbers, groups_of: dict[tuple[int, int], Integers],
                new: bool) -> tuple[list[CellBlock], list[dict[int, Integers]]]:
    blocks, groups = [], []
    for _ in range(int(numbers.take("s", 4 if new else 2)[0])):
        first, second, kind = (int(n) for n in numbers.take("i", 3))
        dimension, tag = (first, second) if new else (second, first)
        count = numbers.one("s")
        table = numbers.take("s" if new else "i", count * (1 + _size(kind))).reshape(count, -1).astype(np.int64)
        blocks.append(CellBlock(TYPES[kind][0], table[:, 1:], table[:, 0]))
        groups.append({int(physical): np.arange(count) for physical in groups_of.get((dimension, tag), ()) if physical})
    return blocks, groups

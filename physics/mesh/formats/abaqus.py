"""Abaqus's .inp files, as CalculiX writes and reads them too: nodes, elements, sets and surfaces, in parts or not.

Keywords and names do not care for capitals. A set may name other sets, be generated (first, last and, if not 1, step), and
stand behind *NODE or *ELEMENT itself. A surface of TYPE = ELEMENT is made of sides S1, S2, .. of cells, by Abaqus's numbers, and
becomes a group of faces; one of TYPE = NODE a set of nodes. Parts are taken together as they stand, each with labels of its
own; an instance that is moved or one of two of a part is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, Corners
from physics.mesh.formats.raw import CellBlock, Raw, block
from physics.schema import InputError

Integers = NDArray[np.int64]

# The beginnings of Abaqus's names: kind, numbers of nodes that there are, the longest first. What follows is how they are integrated.
NAMES = (
    (r"C3D(27|20|8)", "hexahedron", (8, 20, 27)), (r"C3D(10|4)", "tetrahedron", (4, 10)),
    (r"C3D(15|6)", "prism", (6, 15)), (r"SC6", "prism", (6,)), (r"SC8|CSS8", "hexahedron", (8,)), (r"DC3D(20|8)", "hexahedron", (8, 20)),
    (r"DC3D(10|4)", "tetrahedron", (4, 10)), (r"DC3D(15|6)", "prism", (6, 15)),
    (r"(CPS|CPE|CPEG|CAX|DC2D|DCAX|M3D|SFM3D|S|SAX|DS|R3D|STRI)(9|8|4)", "quadrilateral", (4, 8, 9)),
    (r"(CPS|CPE|CPEG|CAX|DC2D|DCAX|M3D|SFM3D|S|DS|R3D|STRI)(65|6|3)", "triangle", (3, 6)),
    (r"(T2D|T3D|B2|B3|B|DC1D|R2D|RAX|SAX|CONN3D|PIPE2|PIPE3|GAPUNI|F2D|F3D)\d*", "line", (2, 3)),
)
SIDES: dict[str, Corners] = {  # S1, S2, ..
    "tetrahedron": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)), "prism": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    "triangle": ((0, 1), (1, 2), (2, 0)), "quadrilateral": ((0, 1), (1, 2), (2, 3), (3, 0))}
MIDDLE_SECOND = [0, 2, 1]  # of lines of three nodes
FACES = {2: "line", 3: "triangle", 4: "quadrilateral"}
PLAIN = {"MASS", "ROTARYI", "SPRINGA", "SPRING1", "SPRING2", "DASHPOTA", "DCOUP3D"}  # no cells: left out


Entry = int | str | range  # a label, the name of another set, a row of labels


class Deck:
    """What is gathered from the lines of a file."""

    def __init__(self) -> None:
        self.nodes: dict[str, dict[int, int]] = {}  # part to label to number
        self.points: list[list[float]] = []
        self.labels: list[int] = []  # of the nodes
        self.tables: dict[tuple[str, int], list[tuple[str, Integers, Integers]]] = {}  # kind, nodes each: part, labels (c,), nodes (c, n)
        self.sets: dict[tuple[str, str], list[tuple[str, Entry]]] = {}  # what ("NSET" or "ELSET") and name: part and member
        self.sides: dict[str, list[tuple[str, int | str, str]]] = {}
        self.spelled: dict[str, str] = {}  # names as they are first written
        self.instances: list[str] = []

    def name(self, text: str) -> str:
        """A name without regard to capitals."""
        text = text.strip().strip('"')
        self.spelled.setdefault(text.upper(), text)
        return text.upper()


def read(path: Path) -> Raw:
    """An .inp file. Raises `InputError`, or ValueError, for what is not one."""
    deck, part = Deck(), ""
    for keyword, options, lines in _keywords(path):
        if keyword == "PART":
            part = deck.name(options.get("NAME", ""))
        elif keyword in ("END PART", "END INSTANCE"):
            part = ""
        elif keyword == "INSTANCE":
            deck.instances.append(deck.name(options.get("PART", "")))
            if any(abs(float(word)) > 0 for line in lines for word in line):
                raise InputError("an *INSTANCE is moved: export the mesh as one part, in its place")
            if len(set(deck.instances)) < len(deck.instances):
                raise InputError(f"two instances of part {options.get('PART')}: export the mesh as one part")
        elif keyword == "NODE":
            known = deck.nodes.setdefault(part, {})
            for line in lines:
                if int(line[0]) in known:
                    raise InputError(f"node {line[0]} is there twice")
                known[int(line[0])] = len(deck.points)
                deck.labels.append(int(line[0]))
                deck.points.append([float(word or 0) for word in (*line[1:4], "0", "0", "0")[:3]])
            if "NSET" in options:
                deck.sets.setdefault(("NSET", deck.name(options["NSET"])), []).extend((part, int(line[0])) for line in lines)
        elif keyword == "ELEMENT":
            _elements(deck, part, options, lines)
        elif keyword in ("NSET", "ELSET"):
            _set(deck, part, keyword, options, lines)
        elif keyword == "SURFACE":
            _surface(deck, part, options, lines)
    return _raw(deck)


def _keywords(path: Path, depth: int = 0) -> Iterator[tuple[str, dict[str, str], list[list[str]]]]:
    """Each keyword with its options and its lines of data, split at the commas; included files in their place."""
    if depth > 9:
        raise InputError(f"{path.name} is included by itself")
    keyword, options, lines, more = "", dict[str, str](), list[list[str]](), False
    for line in path.read_text(errors="replace").splitlines():
        if line.startswith("**") or not line.strip():
            continue
        words = [word.strip() for word in line.split(",")]
        if line.lstrip().startswith("*") or more:
            if not more:
                if keyword:
                    yield keyword, options, lines
                keyword, options, lines = " ".join(words.pop(0).lstrip("* ").upper().split()), {}, []
            more = line.rstrip().endswith(",")
            options |= {key.strip().upper(): value.strip() for key, _, value in (word.partition("=") for word in words if word)}
            if keyword == "INCLUDE" and not more:
                there = Path(options.get("INPUT", ""))
                if not (there.is_absolute() or (path.parent / there).is_file()):
                    raise InputError(f"*INCLUDE, INPUT={there}: no such file")
                yield from _keywords(path.parent / there, depth + 1)
                keyword = ""
        else:
            lines.append([word for word in words if word] if keyword in ("ELEMENT", "NSET", "ELSET") else words)
    if keyword:
        yield keyword, options, lines


def _elements(deck: Deck, part: str, options: dict[str, str], lines: list[list[str]]) -> None:
    name = options.get("TYPE", "").upper()
    if name in PLAIN:
        return
    found = next(((kind, sizes) for pattern, kind, sizes in NAMES if re.match(f"({pattern})", name)), None)
    if found is None or not lines:
        raise InputError(f"*ELEMENT, TYPE={name}: not a type of cell that is known here")
    kind, sizes = found
    digits = re.match(r"(?:CPS|CPE|CPEG|CAX|DC2D|DCAX|M3D|SFM3D|S|SAX|DS|R3D|STRI|C3D|DC3D|SC)(65|27|20|15|10|9|8|6|4|3)", name)
    said = {"65": 6}.get(digits[1], int(digits[1])) if digits else 0
    size = said if said in sizes else len(lines[0]) - 1 if kind == "line" else sizes[0]
    numbers = np.array([int(word) for line in lines for word in line if word], np.int64)
    if (kind == "line" and any(len(line) != len(lines[0]) for line in lines)) or len(numbers) % (1 + size):
        raise InputError(f"*ELEMENT, TYPE={name}: {len(numbers)} numbers are not cells of a label and {size} nodes")
    labels, known = numbers.reshape(-1, 1 + size)[:, 0], deck.nodes.get(part, {})
    nodes = np.array([known.get(label, -1) for label in numbers.reshape(-1, 1 + size)[:, 1:].ravel().tolist()], np.int64).reshape(-1, size)
    if (wrong := np.argwhere(nodes < 0)).size:
        row, at = wrong[0]
        raise InputError(f"cell {labels[row]} names node {numbers.reshape(-1, 1 + size)[row, 1 + at]}, which is not there")
    deck.tables.setdefault((kind, size), []).append((part, labels, nodes))
    if "ELSET" in options:
        deck.sets.setdefault(("ELSET", deck.name(options["ELSET"])), []).extend((part, label) for label in labels.tolist())


def _set(deck: Deck, part: str, keyword: str, options: dict[str, str], lines: list[list[str]]) -> None:
    if keyword not in options:
        raise InputError(f"*{keyword} without a name")
    members = deck.sets.setdefault((keyword, deck.name(options[keyword])), [])
    owner = _owner(deck, part, options)
    for line in lines:
        if "GENERATE" in options:
            if len(line) not in (2, 3) or not all(word.lstrip("-").isdigit() for word in line):
                raise InputError(f"*{keyword}, {options[keyword]}, GENERATE: a line must have a first, a last and perhaps a step")
            first, last, step = (int(word) for word in (*line, "1")[:3])
            if step < 1:
                raise InputError(f"*{keyword}, {options[keyword]}, GENERATE: {', '.join(line)} is no row of numbers")
            members.append((owner, range(first, last + 1, step)))
        else:
            for word in line:
                last_word = word.rpartition(".")[2]
                members.append((owner if word == last_word else _part_of(deck, word), int(last_word)) if last_word.isdigit()
                               else (owner, deck.name(word)))


def _owner(deck: Deck, part: str, options: dict[str, str]) -> str:
    """Whose labels a set has: its part's, or those of the instance that it names."""
    return _part_of(deck, options["INSTANCE"]) if "INSTANCE" in options else part


def _part_of(deck: Deck, text: str) -> str:
    """The part behind an instance: the only one, or the one after which instances are named (PART-1)."""
    parts = set(deck.nodes)
    name = text.split(".")[0].strip().strip('"').upper()
    return next((owner for owner in (name, name.rpartition("-")[0]) if owner in parts), next(iter(parts)) if len(parts) == 1 else name)


def _surface(deck: Deck, part: str, options: dict[str, str], lines: list[list[str]]) -> None:
    name = deck.name(options.get("NAME", ""))
    for line in (line for line in lines if line and line[0]):
        word: int | str = int(line[0]) if line[0].isdigit() else deck.name(line[0])
        if options.get("TYPE", "ELEMENT").upper() == "NODE":
            deck.sets.setdefault(("NSET", name), []).append((part, word))
        elif len(line) > 1 and re.fullmatch(r"S[1-6]", line[1].upper()):
            deck.sides.setdefault(name, []).append((part, word, line[1].upper()))


def _members(deck: Deck, what: str, name: str, seen: tuple[str, ...] = ()) -> list[tuple[str, int]]:
    """All part-and-label pairs of a set, those of the sets that it names too; of rows of labels those that there are."""
    if name in seen:
        raise InputError(f"set {deck.spelled[name]} names itself")
    found = []
    for owner, entry in deck.sets[what, name]:
        if isinstance(entry, int):
            found.append((owner, entry))
        elif isinstance(entry, range):
            tables = (labels.tolist() for rows in deck.tables.values() for part, labels, _ in rows if part == owner)
            there = deck.nodes.get(owner, {}) if what == "NSET" else [label for labels in tables for label in labels]
            found += [(owner, label) for label in there if label in entry]
        elif (what, entry) in deck.sets:
            found += _members(deck, what, entry, (*seen, name))
        else:
            raise InputError(f"set {deck.spelled[name]} names set {deck.spelled[entry]}, which is not there")
    return list(dict.fromkeys(found))


def _raw(deck: Deck) -> Raw:
    blocks: list[CellBlock] = []
    place: dict[tuple[str, int], tuple[int, int]] = {}  # part and label to block and row
    for (kind, size), rows in deck.tables.items():
        owners = [(part, label) for part, labels, _ in rows for label in labels.tolist()]
        place |= {key: (len(blocks), i) for i, key in enumerate(owners)}
        order = MIDDLE_SECOND if kind == "line" and size == 3 else list(range(size))
        blocks.append(block(kind, np.concatenate([nodes for _, _, nodes in rows])[:, order],
                            np.concatenate([labels for _, labels, _ in rows]), () if size == 27 else None))
    groups: dict[tuple[str, int], list[tuple[int, Integers]]] = {}
    node_sets: dict[str, Integers] = {}
    for what, name in deck.sets:
        members = _members(deck, what, name)
        if what == "NSET":
            found = [deck.nodes[part][label] for part, label in members if label in deck.nodes.get(part, {})]
            node_sets[deck.spelled[name]] = np.array(found, np.int64)
        elif pairs := [place[key] for key in members if key in place]:
            number, row = np.array(pairs, np.int64).T
            dimension = max(CELLS[blocks[n].kind].dimension for n in set(number.tolist()))
            groups[deck.spelled[name], dimension] = [(int(n), row[number == n]) for n in np.unique(number)]
    for name, sides in deck.sides.items():
        facets: dict[int, list[Integers]] = {}
        for part, word, side in sides:
            known = not isinstance(word, int) and ("ELSET", word) in deck.sets
            cells = [(part, word)] if isinstance(word, int) else _members(deck, "ELSET", word) if known else []
            for number, row in (place[key] for key in cells if key in place):
                local = SIDES.get(blocks[number].kind, ())
                if int(side[1]) > len(local):
                    raise InputError(f"surface {deck.spelled[name]}: a {blocks[number].kind} has no side {side}")
                corners = blocks[number].nodes[row, list(local[int(side[1]) - 1])]
                facets.setdefault(len(corners), []).append(corners)
        for k, rows_of in facets.items():
            groups.setdefault((deck.spelled[name], k - 1 if k == 2 else 2), []).append((len(blocks), np.arange(len(rows_of))))
            blocks.append(CellBlock(FACES[k], np.stack(rows_of)))
    return Raw(np.array(deck.points, np.float64).reshape(-1, 3), blocks, groups, node_sets,
               np.array(deck.labels, np.int64))

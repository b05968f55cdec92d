""".msh files written number by number as the section "File formats" of gmsh's manual says: versions 2.2 and 4 as text and as bytes."""

import struct

import numpy as np
import pytest

from physics.mesh.formats import gmsh
from physics.schema import InputError

POINTS = {30: (0.0, 0.0, 0.0), 10: (1.0, 0.25, 0.0), 7: (0.0, 1.0, 0.5), 5: (0.125, 0.0, 2.0), 20: (1.0, 1.0, 1.0)}  # label to place
ORDER = [10, 30, 7, 20, 5]  # in which the nodes stand in version 4
NAMES = b'$PhysicalNames\n3\n2 1 "the wall"\n3 1 "body"\n0 4 "corner"\n$EndPhysicalNames\n'
BOX = [0.0, 0.5, 0.0, 1.0, 1.5, 2.0]
FORMS = {"text": ("", 8), "little": ("<", 8), "big": (">", 8), "short": ("<", 4)}


def rendered(form, parts, wide=True):
    """Pairs of a kind of number, i, d or s, and the numbers, as gmsh writes them; sizes are long where not `wide`."""
    order, size = FORMS[form]
    if not order:
        return "\n".join(" ".join(map(repr, values)) for _, values in parts).encode()
    code = {"i": "i", "d": "d", "s": "I" if size == 4 and wide else "Q"}
    return b"".join(struct.pack(f"{order}{len(values)}{code[kind]}", *values) for kind, values in parts)


def file(form, version, sections):
    order, size = FORMS[form]
    head = b"$MeshFormat\n%s %d %d\n" % (version.encode(), bool(order), size) + (struct.pack(order + "i", 1) + b"\n" if order else b"")
    text = head + b"$EndMeshFormat\n" + NAMES
    return text + b"".join(b"$%s\n%s\n$End%s\n" % (name.encode(), body, name.encode()) for name, body in sections)


def said(path):
    raw = gmsh.read(path)
    groups = {key: [(number, rows.tolist()) for number, rows in members] for key, members in raw.groups.items()}
    blocks = [(block.kind, block.labels.tolist(), raw.labels[block.nodes].tolist()) for block in raw.blocks]
    return {int(label): tuple(x) for label, x in zip(raw.labels, raw.points.tolist(), strict=True)}, raw.labels.tolist(), blocks, groups


@pytest.mark.parametrize("form", ["text", "little", "big"])
def test_cells_of_version_2_tell_their_group_themselves(tmp_path, form):
    """Type 1 is a line, 2 a triangle, 4 a tetrahedron; tags are the physical group, the entity, and of a cut mesh the partitions."""
    elements = [(1, [2, 1], [[3, 30, 10]]), (2, [1, 4], [[9, 30, 10, 7], [8, 10, 7, 5]]), (2, [-3, 4, 1, 2], [[6, 7, 5, 30]]),
                (4, [], [[40, 30, 10, 7, 5]]), (4, [8, 2], [[41, 10, 7, 5, 20]]), (1, [2, 1], [[2, 5, 20]])]
    if form == "text":
        nodes = b"5\n" + rendered(form, [("d", (label, *x)) for label, x in POINTS.items()])
        cells = b"7\n" + rendered(form, [("i", (row[0], kind, len(tags), *tags, *row[1:]))
                                         for kind, tags, rows in elements for row in rows])
    else:
        nodes = b"5\n" + rendered(form, [part for label, x in POINTS.items() for part in (("i", [label]), ("d", x))])
        cells = b"7\n" + rendered(form, [part for kind, tags, rows in elements for part in (
            ("i", (kind, len(rows), len(tags))), *(("i", (row[0], *tags, *row[1:])) for row in rows))])
    (tmp_path / "a.msh").write_bytes(file(form, "2.2", [("Nodes", nodes), ("Elements", cells)]))
    points, labels, blocks, groups = said(tmp_path / "a.msh")
    assert points == POINTS and labels == list(POINTS)
    assert blocks == [("line", [3, 2], [[30, 10], [5, 20]]), ("triangle", [9, 8, 6], [[30, 10, 7], [10, 7, 5], [7, 5, 30]]),
                      ("tetrahedron", [40, 41], [[30, 10, 7, 5], [10, 7, 5, 20]])]
    assert groups == {("2", 1): [(0, [0, 1])], ("the wall", 2): [(1, [0, 1])], ("3", 2): [(1, [2])], ("8", 3): [(2, [1])],
                      ("body", 3): [], ("corner", 0): []}


@pytest.mark.parametrize("version, form", [("4.0", "text"), ("4.0", "little"), ("4.0", "big"), ("4.1", "text"), ("4.1", "little"),
                                           ("4.1", "big"), ("4.1", "short")])
def test_cells_of_version_4_are_in_the_groups_of_the_entity_that_they_lie_on(tmp_path, version, form):
    """Nodes may have places on their entity as well, as many coordinates as it has dimensions; volume 2 was cut from volume 1."""
    new = version == "4.1"
    entities = [("s", (2, 1, 1, 1 if new else 2)),
                *(part for tag in (5, 6)
                  for part in (("i", [tag]), ("d", BOX[:3] if new else BOX), ("s", [tag - 5]), ("i", [4] * (tag - 5)))),
                ("i", [1]), ("d", BOX), ("s", [1]), ("i", [2]), ("s", [2]), ("i", [5, -6]),
                ("i", [4]), ("d", BOX), ("s", [2]), ("i", [1, -3]), ("s", [1]), ("i", [1]),
                ("i", [1]), ("d", BOX), ("s", [1]), ("i", [1]), ("s", [0]), ("i", [])]
    partitioned = [("s", [2]), ("s", [2]), ("i", [90, 1, 91, 2]), ("s", (1, 0, 1, 1)),
                   ("i", [8, 0, 5]), ("s", [1]), ("i", [1]), ("d", BOX[:3]), ("s", [0]),
                   ("i", [9, 2, 4]), ("s", [2]), ("i", [1, 2]), ("d", BOX), ("s", [1]), ("i", [6]), ("s", [1]), ("i", [3]),
                   ("i", [2, 3, 1]), ("s", [1]), ("i", [2]), ("d", BOX), ("s", [2]), ("i", [8, 1]), ("s", [1]), ("i", [9])]
    if not new:
        entities += [("i", [2]), ("d", BOX), ("s", [2]), ("i", [8, 1]), ("s", [1]), ("i", [4])]
    nodes, at = [("s", (3, 5, 1, 30) if new else (3, 5))], 0
    for dimension, tag, parametric, count in ((2, 4, 1, 2), (1, 1, 1, 1), (3, 1, 0, 2)):
        labels = ORDER[at:at + count]
        at += count
        rows = [(*POINTS[label], *[0.75] * (dimension * parametric)) for label in labels]
        if new:
            nodes += [("i", (dimension, tag, parametric)), ("s", [count]), ("s", labels), *(("d", row) for row in rows)]
        else:
            nodes += [("i", (tag, dimension, parametric)), ("s", [count])]
            nodes += [part for label, row in zip(labels, rows, strict=True) for part in (("i", [label]), ("d", row))]
    elements = [("s", (6, 7, 1, 41) if new else (6, 7))]
    for dimension, tag, kind, rows in ((0, 6, 15, [[1, 5]]), (1, 1, 1, [[3, 30, 10]]), (2, 4, 2, [[9, 30, 10, 7], [8, 10, 7, 5]]),
                                       (2, 9, 3, [[6, 7, 5, 30, 10]]), (3, 1, 4, [[40, 30, 10, 7, 5]]), (3, 2, 4, [[41, 10, 7, 5, 20]])):
        elements += [("i", (dimension, tag, kind) if new else (tag, dimension, kind)), ("s", [len(rows)])]
        elements += [("s" if new else "i", row) for row in rows]
    sections = [("Entities", entities), *([("PartitionedEntities", partitioned)] if new else []), ("Nodes", nodes), ("Elements", elements)]
    (tmp_path / "a.msh").write_bytes(file(form, version, [(name, rendered(form, parts)) for name, parts in sections]))
    points, order, blocks, groups = said(tmp_path / "a.msh")
    assert points == POINTS and order == ORDER
    assert blocks == [("vertex", [1], [[5]]), ("line", [3], [[30, 10]]), ("triangle", [9, 8], [[30, 10, 7], [10, 7, 5]]),
                      ("quadrilateral", [6], [[7, 5, 30, 10]]), ("tetrahedron", [40], [[30, 10, 7, 5]]),
                      ("tetrahedron", [41], [[10, 7, 5, 20]])]
    wanted = {("corner", 0): [(0, [0])], ("2", 1): [(1, [0])], ("the wall", 2): [(2, [0, 1])], ("3", 2): [(2, [0, 1])],
              ("body", 3): [(4, [0]), (5, [0])], ("8", 3): [(5, [0])]}
    assert groups == wanted | ({("6", 2): [(3, [0])]} if new else {})


def test_thousands_of_cells_of_one_type_and_a_few_of_another_are_told_apart(tmp_path):
    """Also where the file has more of them than it says."""
    rows = [f"{i + 1} 2 2 {1 + i % 2} 4 30 10 7" for i in range(9000)]
    rows[5000:5000] = [f"{10000 + i} 1 2 2 1 30 10" for i in range(3)]
    for count in (9003, 8000):
        nodes = b"5\n" + rendered("text", [("d", (label, *x)) for label, x in POINTS.items()])
        sections = [("Nodes", nodes), ("Elements", f"{count}\n".encode() + "\n".join(rows).encode())]
        (tmp_path / "a.msh").write_bytes(file("text", "2.2", sections))
        raw = gmsh.read(tmp_path / "a.msh")
        assert [(block.kind, block.labels.tolist()) for block in raw.blocks] == [
            ("triangle", list(range(1, count - 2))), ("line", [10000, 10001, 10002])]
        assert [rows.tolist() for _, rows in raw.groups["2", 2]] == [list(range(1, count - 3, 2))]


@pytest.mark.parametrize("form, blocks, words", [("text", 2, "shorter than it says"), ("text", -1, "shorter than it says"),
                                                 ("little", 10**6, "shorter than it says")])
def test_a_section_that_ends_early_is_said(tmp_path, form, blocks, words):
    parts = [("s", (1, 5, 1, 30)), ("i", (3, 1, 0)), ("s", [5]), ("s", ORDER), *(("d", POINTS[label]) for label in ORDER)]
    for count in (1, blocks):
        cells = [("s", (1, 1, 1, 1)), ("i", (3, 1, 4)), ("s", [abs(count)]), ("s", [40, 30, 10, 7, 5][:None if count > 0 else 4])]
        (tmp_path / "a.msh").write_bytes(file(form, "4.1", [("Elements", rendered(form, cells)), ("Nodes", rendered(form, parts))]))
        if count == 1:
            assert gmsh.read(tmp_path / "a.msh").blocks[0].nodes.tolist() == [[1, 0, 2, 4]]
        else:
            with pytest.raises(InputError, match=words):
                gmsh.read(tmp_path / "a.msh")
    sections = [("Nodes", b"1 1 1 1\n3 1 0 -1"), ("Elements", b"")]
    (tmp_path / "a.msh").write_bytes(file("text", "4.1", sections))
    with pytest.raises(InputError, match="a negative number of entries"):
        gmsh.read(tmp_path / "a.msh")


def test_a_table_of_labels_and_places_ends_with_its_bytes():
    """Rows of 4 and 3 x 8 bytes: the last of two is read, and of three there is none."""
    data = b"".join(struct.pack("<i3d", label, *POINTS[label]) for label in (7, 20))
    numbers = gmsh.Numbers(data, 0, binary=True, end=b"", size="u8", order="<")
    labels, x = numbers.labelled(2, 3)
    assert labels.tolist() == [7, 20] and x.tolist() == [list(POINTS[7]), list(POINTS[20])] and numbers.at == len(data) == 56
    assert np.array_equal(numbers.take("i", 0), [])
    for count in (3, -1):
        with pytest.raises(InputError, match="shorter than it says"):
            gmsh.Numbers(data, 0, binary=True, end=b"", size="u8", order="<").labelled(count, 3)
    with pytest.raises(InputError, match="shorter than it says"):
        numbers.take("i", 1)

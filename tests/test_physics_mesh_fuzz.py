"""Whatever a mesh file says, reading it and looking for modes ends in status 0, 1 or 2 and one line: never in a signal or a traceback.

Sound files of several formats are damaged at random, in their text, their bytes or the meaning of their numbers. Each is read by a
child of its own, so that a signal would be seen.
"""

import os
import random
import shutil
import signal
import sys
import traceback

import meshio
import numpy as np
import pytest

import fidelity
import physics.modes.elastic
import physics.modes.laplacian  # noqa: F401  loaded once, before the children are made
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS as CELL
from physics.scene import read_body

SEED, COUNT = int(os.environ.get("FUZZ_SEED", "20261127")), 300
CELLS = {"prism": "wedge", "tetrahedron": "tetra", "hexahedron": "hexahedron", "triangle": "triangle", "quadrilateral": "quad"}
SCENE = ('[body]\nshape = "file"\npath = "{path}"\norder = {order}\n[material]\nyoung_modulus = 1e6\npoisson_ratio = 0.3\n'
         '[[support]]\nwhere = {{ plane = [0, 0, 0], normal = [1, 0, 0], within = 1e-6 }}\n')
ODD = ("0", "-1", "1", "2", "7", "1e300", "-1e300", "nan", "inf", "1e-300", "99999999999", "2147483648", "4", "3", "x", "", "*NODE", "1,1")


def sound_files(folder):
    """One beam or plate in many formats."""
    files = []
    for cell, name in CELLS.items():
        plane = cell in ("triangle", "quadrilateral")
        sides = {"shape": "plate" if plane else "beam", "length": 0.4, "width": 0.1} | ({} if plane else {"height": 0.1})
        mesh = build_mesh(read_body({"body": sides | {"cell": cell, "cells": [3, 2] if plane else [3, 2, 1]}}))
        wall = next(facets for facets in mesh.facets("x-min") if len(facets))
        blocks = [(name, mesh.cells), ({2: "line", 3: "triangle", 4: "quad"}[wall.shape[1]], wall)]
        tags = [np.full(len(data), 1 + i) for i, (_, data) in enumerate(blocks)]
        entity = np.tile([mesh.dimension, 1], (len(mesh.points), 1))
        tagged = meshio.Mesh(mesh.points, blocks, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
                             field_data={"wall": np.array([2, mesh.dimension - 1])})
        plain = meshio.Mesh(mesh.points, blocks[:1], point_sets={"WALL": mesh.places["x-min"]})
        for ending, binary in ((".msh22", False), (".msh22", True), (".msh41", False), (".msh41", True)):
            path = folder / f"{cell}{ending}{binary:d}.msh"
            given = meshio.Mesh(tagged.points, tagged.cells, cell_data=dict(tagged.cell_data), field_data=tagged.field_data,
                                point_data={"gmsh:dim_tags": entity} if ending == ".msh41" else {})
            meshio.write(path, given, file_format="gmsh22" if ending == ".msh22" else "gmsh", binary=binary)
            files.append(path)
        for ending in (".inp", ".vtu", ".vtk", ".bdf", ".mesh", ".med", ".xdmf"):
            path = folder / f"{cell}{ending}"
            (plain if ending == ".inp" else meshio.Mesh(mesh.points, blocks[:1])).write(path)
            files.append(path)
        rows = [f"{CELL[cell].vtk} {' '.join(map(str, row))}" for row in mesh.cells]
        path = folder / f"{cell}.su2"
        path.write_text("\n".join([f"NDIME= {mesh.dimension}", f"NELEM= {len(rows)}", *rows, f"NPOIN= {len(mesh.points)}",
                                   *(" ".join(map(str, x[:mesh.dimension])) for x in mesh.points), "NMARK= 0"]) + "\n")
        files.append(path)
    return files


def damaged(data, draw):
    """The bytes of a file with one to three things wrong."""
    for _ in range(draw.choice((1, 1, 2, 3))):
        if len(data) < 2:
            break
        lines = data.split(b"\n")
        kind = draw.randrange(8)
        if kind == 0:  # cut off
            data = data[:draw.randrange(1, len(data))]
        elif kind == 1:  # a byte or four
            at = draw.randrange(len(data))
            data = data[:at] + draw.randbytes(draw.choice((1, 4))) + data[at + draw.choice((0, 1, 4)):]
        elif kind == 2:  # a line twice, or gone
            at = draw.randrange(len(lines))
            data = b"\n".join(lines[:at] + [lines[at]] * draw.choice((0, 2)) + lines[at + 1:])
        else:  # numbers: others, or in another order
            at = draw.randrange(len(lines))
            comma = b", " if b"," in lines[at] else b" "
            words = lines[at].replace(b",", b" ").split()
            if not words:
                continue
            if kind < 6:
                words[draw.randrange(len(words))] = draw.choice(ODD).encode() if kind < 5 else draw.choice(words)
            else:
                i, j = draw.randrange(len(words)), draw.randrange(len(words))
                words[i], words[j] = words[j], words[i]
            data = b"\n".join(lines[:at] + [comma.join(words)] + lines[at + 1:])
    return data


def misconceived(source, path, draw):
    """A mesh whose file is well formed, with one to three things wrong about its cells and nodes."""
    mesh = meshio.read(source)
    points, cells = mesh.points.copy(), mesh.cells[0].data.copy()
    for _ in range(draw.choice((1, 1, 2, 3))):
        row, at, node = draw.randrange(len(cells)), draw.randrange(cells.shape[1]), draw.randrange(len(points))
        kind = draw.randrange(8)
        if kind == 0:
            cells = np.concatenate([cells, cells[[row]]])
        elif kind == 1:  # another node, perhaps one of its own
            cells[row, at] = draw.choice((node, cells[row, draw.randrange(cells.shape[1])]))
        elif kind == 2:  # corners in another order
            cells[row] = draw.sample(cells[row].tolist(), cells.shape[1])
        elif kind == 3:  # one cell over others
            cells = np.concatenate([cells, [draw.sample(range(len(points)), cells.shape[1])]])
        elif kind == 4:  # a node elsewhere
            points[node, :2] += np.array([draw.gauss(0, 1), draw.gauss(0, 1)]) * draw.choice((1e-9, 0.02, 0.2, 1e3, 1e290))
        elif kind == 5:  # torn off, at the same place
            points, cells = np.concatenate([points, points[cells[row]]]), cells.copy()
            cells[row] = np.arange(len(points) - cells.shape[1], len(points))
        elif kind == 6:  # two nodes one, or a cell gone
            cells = np.where(cells == node, cells[row, at], cells) if draw.random() < 0.5 else np.delete(cells, row, axis=0)
        else:  # all in another order, or the same way wrong
            cells = cells[:, draw.sample(range(cells.shape[1]), cells.shape[1])]
    meshio.Mesh(points, [(mesh.cells[0].type, cells)]).write(path)


def in_a_child(arguments, told):
    """The status of the command line in a child, and what it wrote; told: a file for that. A signal is a negative status."""
    child = os.fork()
    if not child:
        status = 99
        try:
            signal.alarm(60)
            handle = os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(handle, 1)
            os.dup2(handle, 2)
            sys.stdout = sys.stderr = os.fdopen(handle, "w")  # in place of those that pytest captures
            status = fidelity.main(arguments)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), told.read_text(errors="replace")


@pytest.mark.slow
def test_300_damaged_meshes_end_in_one_line_and_never_in_a_signal(tmp_path):
    draw = random.Random(SEED)
    files = sound_files(tmp_path)
    ends, wrong = {0: 0, 1: 0, 2: 0}, []
    for number in range(COUNT):
        source = draw.choice([file for file in files if file.suffix == ".vtu"] if number % 2 else files)
        folder = tmp_path / f"{number}"
        folder.mkdir()
        path = folder / source.name
        if source.suffix == ".vtu" and number % 2:
            misconceived(source, path, draw)
        else:
            path.write_bytes(damaged(source.read_bytes(), draw))
        if source.suffix == ".xdmf":
            shutil.copy(source.with_suffix(".h5"), folder)
        (folder / "scene.toml").write_text(SCENE.format(path=path.name, order=1 if "prism" in source.name else draw.choice((1, 2))))
        kind = draw.choice(("laplacian", "elastic"))
        before = path.read_bytes()
        status, said = in_a_child(["modes", str(folder / "scene.toml"), "--kind", kind, "--count", "1"], tmp_path / "told")
        if status not in ends or "Traceback" in said or "Warning" in said or (status and len(said.splitlines()) != 1):
            wrong.append((number, source.name, kind, status, said[-600:]))
            continue
        assert path.read_bytes() == before
        ends[status] += 1
    print(f"seed {SEED}: {ends}, wrong {len(wrong)}")
    assert not wrong, "\n".join(map(str, wrong[:10]))
    assert ends[0] > COUNT / 10 and ends[2] > COUNT / 3  # both are met

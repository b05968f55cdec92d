"""A drawing cut into cells by gmsh: .step, .iges, .brep, and the .geo of gmsh itself.

gmsh runs by itself on a copy in a folder of its own, where no options of a user's or a stranger's reach it, so that the same drawing
gives the same cells. A .geo is a program: one that runs commands, writes files or reads any but drawings is refused unread. Surfaces
and lines that a drawing has no names for are places by the numbers that gmsh gives them: surface-3, curve-4.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physics.mesh.formats import gmsh
from physics.mesh.formats.raw import Raw
from physics.scene import DRAWINGS
from physics.schema import InputError, missing

Floats = NDArray[np.float64]

SCRIPT = (".geo", ".geo_unrolled")
EXACT = tuple(ending for ending in DRAWINGS if ending not in SCRIPT)
REFUSED = ("SystemCall", "System", "NonBlockingSystemCall", "OnelabRun", "ExternalProcess", "CommandLine", "Plugin", "Save", "Print",
           "Include", "Open", "OpenProject", "MergeWithBoundingBox", "ShapeFromFile", "CreateDir", "Sleep", "General", "Solver", "Onelab")
ROUND = 8  # cells around a full turn of a curved side, at least
FINEST = 2000  # cells along the diagonal of a drawing
LONGEST = 600  # seconds that gmsh may take
MESSAGE = 10_000  # bytes of what it says
LIMITS = ("prlimit", f"--as={16 * 2**30}", f"--fsize={4 * 2**30}")  # bytes of memory, and of a file
SCRIPTED = "cut here.geo"  # no name that a Merge may have
Near = tuple[Floats, NDArray[np.int64], Floats]

# Every part that has a name keeps it; what has none is called by its number. (1: points, 2: curves, 3: surfaces, 4: volumes)
NAMES = """
v() = Volume{:}; s() = Surface{:}; c() = Curve{:};
pv() = Physical Volume{:}; ps() = Physical Surface{:}; pc() = Physical Curve{:};
If (#v() > 0 && #pv() == 0)
  Physical Volume("body") = {v()};
EndIf
If (#v() > 0 && #ps() == 0)
  For i In {0:#s()-1}
    Physical Surface(Sprintf("surface-%g", s(i))) = {s(i)};
  EndFor
EndIf
If (#v() == 0 && #ps() == 0 && #s() > 0)
  Physical Surface("body") = {s()};
EndIf
If (#v() == 0 && #pc() == 0)
  For i In {0:#c()-1}
    Physical Curve(Sprintf("curve-%g", c(i))) = {c(i)};
  EndFor
EndIf
"""


@dataclass(frozen=True)
class Cut:
    """How a drawing is cut.

    size: edges of the cells [m], shorter on curved sides; None: those that a .geo asks for, or a tenth of the diagonal
    parts: of the diagonal, in place of a size
    near: corners (N, 3) [m] and simplices (C, k) of a mesh of the body, and the size (N,) [m] at each corner, in place of both
    """

    size: float | None = None
    parts: int | None = None
    near: Near | None = None

    def scaled(self, scale: float) -> Cut:
        """In units of a drawing, each so many metres."""
        near = self.near and (self.near[0] / scale, self.near[1], self.near[2] / scale)
        return Cut(self.size and self.size / scale, self.parts, near)


def read(path: Path, cut: Cut, order: int) -> Raw:
    """The mesh of a drawing, with cells of an order. Raises `InputError` for what gmsh cannot mesh.

    Coordinates of .step and .iges, which say their units, are in metres.
    """
    if shutil.which("gmsh") is None:
        raise InputError("a drawing, which gmsh cuts into cells, and gmsh is not installed: apt-get install gmsh")
    if why := missing(path):
        raise InputError(why)
    with tempfile.TemporaryDirectory(prefix="fidelity-drawing-") as name:
        folder = Path(name)
        for source in (path, *_merged(path)):
            shutil.copyfile(source, folder / source.name)
        (folder / SCRIPTED).write_text(_script(path, cut))
        command = [*LIMITS, "gmsh", path.name, SCRIPTED, "-setstring", "Geometry.OCCTargetUnit", "M", "-3", "-order", str(order),
                   "-format", "msh41", "-bin", "-nt", "1", "-v", "1", "-o", "cut.msh"]
        if cut.near is not None:
            (folder / "sizes.pos").write_text(_sizes(*cut.near))
            command += ["-bgm", "sizes.pos"]
        with open(folder / "said", "w+b") as said:
            try:
                status = subprocess.run(command, cwd=folder, env={"HOME": name, "PATH": "/usr/bin:/bin", "LC_ALL": "C"}, stdout=said,
                                        stderr=said, timeout=LONGEST, stdin=subprocess.DEVNULL, check=False).returncode
            except subprocess.TimeoutExpired:
                raise InputError(f"gmsh did not cut it into cells within {LONGEST} s; is body.cell_size too small?") from None
            said.seek(0)
            errors = [line.partition(b":")[2].strip().decode(errors="replace") for line in said.read(MESSAGE).splitlines()
                      if line.startswith(b"Error")]
        if errors or status or not (folder / "cut.msh").exists():
            raise InputError(f"gmsh cannot cut it into cells: {errors[0][:200] if errors else f'it ended with status {status}'}")
        if b"$Nodes" not in (folder / "cut.msh").read_bytes():
            raise InputError("draws nothing that could be cut into cells")
        return gmsh.read(folder / "cut.msh")


def _merged(path: Path) -> list[Path]:
    """Other drawings that a .geo merges. Raises `InputError` for a script that does more than to draw."""
    if path.suffix.lower() not in SCRIPT:
        return []
    text = re.sub(r'//[^\n]*|/\*.*?\*/|("(?:[^"\n])*")', lambda found: found[1] or " ", path.read_text(errors="replace"), flags=re.S)
    words = re.sub(r'"[^"\n]*"', '""', text)
    for word in REFUSED:
        if found := re.search(rf"\b{word}\b", words):
            raise InputError(f"line {_line(path, word)}: {found[0]} is not followed: a .geo from others may draw, and neither run "
                             "commands nor read or write files")
    if re.search(r"\b(Printf|Error|Warning)\b[^;]*>", words):
        raise InputError("it writes to a file, which is not followed: a .geo from others may draw only")
    others = []
    for found in re.finditer(r"\bMerge\b\s*(\(?\s*\"([^\"\n]*)\")?", text):
        other = path.parent / (found[2] or "")
        if found[2] is None or Path(found[2]).name != found[2] or other.suffix.lower() not in EXACT:
            raise InputError(f"Merge of {found[2] or 'no plain name'}: a .geo may merge {', '.join(EXACT)} files beside it only")
        if why := missing(other):
            raise InputError(f"Merge of {other.name}: {why}")
        others.append(other)
    return others


def _line(path: Path, word: str) -> int:
    """The number of the first line that has a word."""
    lines = path.read_text(errors="replace").splitlines()
    return next((i for i, line in enumerate(lines, 1) if re.search(rf"\b{word}\b", line)), 1)


def _script(path: Path, cut: Cut) -> str:
    """What gmsh does with a drawing when it is read: name its parts, take the sizes."""
    lines = [NAMES, "Mesh.SaveAll = 0; Mesh.SecondOrderLinear = 0; Mesh.HighOrderOptimize = 1;"]
    size = f"General.BoundingBoxSize / {cut.parts}" if cut.parts else None if cut.size is None else repr(cut.size)
    if cut.near is None and size is not None:
        lines += [f"h = {size}; Mesh.MeshSizeMax = h; Mesh.MeshSizeFromPoints = 0; Mesh.MeshSizeFromCurvature = {ROUND};",
                  "Background Field = -1;",
                  f"If (General.BoundingBoxSize > {FINEST} * h)",
                  f'  Error("cells of %g along a diagonal of %g: more than {FINEST}", h, General.BoundingBoxSize); Exit;',
                  "EndIf"]
    elif cut.near is None and path.suffix.lower() in EXACT:
        lines.append(f"Mesh.MeshSizeFromCurvature = {ROUND};")
    elif cut.near is not None:
        lines.append("Mesh.MeshSizeExtendFromBoundary = 0; Mesh.MeshSizeFromPoints = 0; Mesh.MeshSizeFromCurvature = 0;")
    return "\n".join([*lines, ""])


def _sizes(points: Floats, cells: NDArray[np.int64], sizes: Floats) -> str:
    """The view of sizes at the corners of simplices, in gmsh's format of them."""
    kind = {3: "ST", 4: "SS"}[cells.shape[1]]
    rows = np.column_stack([points[cells].reshape(len(cells), -1), sizes[cells]])
    split = 3 * cells.shape[1]
    lines = (f"{kind}({','.join(f'{x:.9g}' for x in row[:split])}){{{','.join(f'{x:.6g}' for x in row[split:])}}};"
             for row in rows.tolist())
    return "\n".join(['View "sizes" {', *lines, "};"])

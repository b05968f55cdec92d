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
from dataclasses import dataclass, replace
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
           "Include", "Open", "OpenProject", "MergeWithBoundingBox", "ShapeFromFile", "CreateDir", "Sleep", "General", "Solver", "Onelab",
           "ListFromFile", "FileName", "p4estFileToLoad")
BRANCHES = {"If", "ElseIf", "Else", "For", "Macro", "Function"}
BYTES = "latin-1"  # a character for each, as gmsh reads them
TEXT = re.compile(r"""//[^\n\r]*|/\*.*?\*/|"[^"\n\r]{0,500}(?<!\\)"|'[^'\n\r]{0,500}(?<!\\)'|(?P<open>/\*|["'])""", re.DOTALL)
WORD = re.compile(r"[A-Za-z_]\w*", re.ASCII)
ROUND = 8  # cells around a full turn of a curved side, at least
FINEST = 2000  # cells along the diagonal of a drawing
LONGEST = 600  # seconds that gmsh may take
# It ends with whoever waits for it. Bytes of memory, and of a file, and seconds.
LIMITS = ("setpriv", "--pdeathsig", "KILL", "prlimit", f"--as={16 * 2**30}", f"--fsize={4 * 2**30}", f"--cpu={LONGEST}")
SCRIPTED = "cut.geo"
MILLIMETRE = 1e-3
OPTIMISED = ("Failed to reach critical value", "Optimization failed")  # what it says of curved cells that stay inside out
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

    Coordinates of .step and .iges, which say their units, are in metres; of an .iges that a .geo merges in millimetres.
    """
    if shutil.which("gmsh") is None:
        raise InputError("a drawing, which gmsh cuts into cells, and gmsh is not installed: apt-get install gmsh")
    if why := missing(path):
        raise InputError(why)
    with tempfile.TemporaryDirectory(prefix="fidelity-drawing-") as name:
        folder = Path(name)
        source = _copy(path, folder)
        unit = MILLIMETRE if Path(source).suffix in (".iges", ".igs") else 1.0
        cut = cut.scaled(unit)
        if cut.near is not None:
            (folder / "sizes.pos").write_text(_sizes(*cut.near))
        for around in (0 if cut.near is not None else ROUND, 2 * ROUND, 4 * ROUND):
            (folder / SCRIPTED).write_text(_script(path, cut, around))
            why = _run(folder, source, order, graded=cut.near is not None)
            if not why.startswith(OPTIMISED):  # else curved cells are inside out: more of them around a turn
                break
        if why:
            finer = "; would a smaller body.cell_size do?" if why.startswith((*OPTIMISED, "PLC Error")) else ""
            raise InputError(f"gmsh cannot cut it into cells: {why}{finer}")
        made = (folder / "cut.msh").read_bytes()
        if b"$Nodes" not in made:
            raise InputError("draws nothing that could be cut into cells")
        if b"$EndElements" not in made:
            raise InputError(f"gmsh could not write its cells whole: is {folder.parent} full?")
        raw = gmsh.read(folder / "cut.msh")
        return raw if unit == 1.0 else replace(raw, points=raw.points * unit)


def _run(folder: Path, source: str, order: int, *, graded: bool) -> str:
    """Why gmsh made no mesh of a drawing in a folder; "" when it did."""
    command = [*LIMITS, "gmsh", source, SCRIPTED, "-3", "-order", str(order), "-format", "msh41", "-bin", "-nt", "1", "-v", "1",
               "-o", "cut.msh", *(["-bgm", "sizes.pos"] if graded else [])]
    if not {".iges", ".igs"} & {part.suffix for part in folder.iterdir()}:  # gmsh reads no .iges in another unit than its own
        command += ["-setstring", "Geometry.OCCTargetUnit", "M"]
    with open(folder / "said", "w+b") as said:
        try:
            status = subprocess.run(command, cwd=folder, env={"HOME": str(folder), "PATH": "/usr/bin:/bin", "LC_ALL": "C"}, stdout=said,
                                    stderr=said, timeout=LONGEST, stdin=subprocess.DEVNULL, check=False).returncode
        except subprocess.TimeoutExpired:
            raise InputError(f"gmsh did not cut it into cells within {LONGEST} s; is body.cell_size too small?") from None
        said.seek(0)
        error = next((line for line in said if line.startswith(b"Error")), b"").partition(b":")[2].strip().decode(errors="replace")
    if error or status or not (folder / "cut.msh").exists():
        return error[:200] or f"it ended with status {status}"
    return ""


def _copy(path: Path, folder: Path) -> str:
    """The name under which a drawing lies in a folder, and those that it merges beside it. Raises `InputError`.

    gmsh tells what a file is by its ending, in small letters, and takes one that it does not know for a script.
    """
    name = f"drawing{path.suffix.lower()}"
    if path.suffix.lower() in SCRIPT:
        text, others = _checked(path)
        (folder / name).write_bytes(text.encode(BYTES))
        for merged, other in others.items():
            shutil.copyfile(other, folder / merged)
    else:
        shutil.copyfile(path, folder / name)
    return name


def _checked(path: Path) -> tuple[str, dict[str, Path]]:
    """A script without its comments, and the drawings that it merges by the names that they have there.

    Raises `InputError` for one that does more than to draw, or of which it is not sure where its texts end: gmsh might see a command
    where a text is seen here.
    """
    text = path.read_bytes().decode(BYTES)

    def said(at: int, why: str) -> InputError:
        return InputError(f"line {text.count(chr(10), 0, at) + 1}: {why}")

    if found := re.search("[\0\xff]", text):
        raise said(found.start(), "a byte that no text has")
    for found in TEXT.finditer(text):
        if found["open"]:
            raise said(found.start(), "a text or comment that does not end, on its line a text, or is too long")
    text = TEXT.sub(lambda found: found[0] if found[0][0] in "\"'" else re.sub(r"[^\n]", " ", found[0]), text)
    code = TEXT.sub(lambda found: found[0][0] + "." * (len(found[0]) - 2) + found[0][0], text)
    for found in WORD.finditer(code):
        if found[0] in REFUSED:
            raise said(found.start(), f"{found[0]} is not followed: a .geo from others may draw, and neither run commands nor read or "
                                      "write files")
    if found := re.search(r"(Printf|Error|Warning)\b[^;]*>", code, re.ASCII):
        raise said(found.start(), "it writes to a file, which is not followed: a .geo from others may draw only")
    if BRANCHES & set(WORD.findall(code)):  # gmsh looks for their ends within texts as well
        for found in TEXT.finditer(text):
            if end := re.search("EndIf|EndFor|Else|Return", found[0]):
                raise said(found.start(), f"{end[0]} within a text, which gmsh may take for the end of a branch")
    others: dict[str, Path] = {}
    pieces, start = [], 0
    for found in re.finditer(r"Merge\b(\s*\(?\s*)(\"\.*\"|'\.*')?", code, re.ASCII):
        given = text[found.start(2) + 1:found.end(2) - 1].encode(BYTES).decode(errors="replace") if found[2] else ""
        other = path.parent / given
        if not given or Path(given).name != given or other.suffix.lower() not in EXACT:
            raise said(found.start(), f"Merge of {given or 'no plain name'}: a .geo may merge {', '.join(EXACT)} files beside it only")
        if why := missing(other):
            raise said(found.start(), f"Merge of {given}: {why}")
        name = f"merged-{len(others) + 1}{other.suffix.lower()}"
        others[name] = other
        pieces += [text[start:found.start()], f'Merge{found[1]}"{name}"']
        start = found.end()
    return "".join([*pieces, text[start:]]), others


def _script(path: Path, cut: Cut, around: int) -> str:
    """What gmsh does with a drawing when it is read: name its parts, take the sizes."""
    lines = [NAMES, "Mesh.SaveAll = 0; Mesh.SecondOrderLinear = 0; Mesh.HighOrderOptimize = 1;"]
    size = f"General.BoundingBoxSize / {cut.parts}" if cut.parts else None if cut.size is None else repr(float(cut.size))
    if cut.near is not None:
        lines.append(f"Mesh.MeshSizeExtendFromBoundary = 0; Mesh.MeshSizeFromPoints = 0; Mesh.MeshSizeFromCurvature = {around};")
    elif size is not None:
        lines += [f"h = {size}; Mesh.MeshSizeMax = h; Mesh.MeshSizeFromPoints = 0; Mesh.MeshSizeFromCurvature = {around};",
                  "Background Field = -1;",
                  f"If (General.BoundingBoxSize > {FINEST} * h)",
                  f'  Error("cells of %g along a diagonal of %g: more than {FINEST}", h, General.BoundingBoxSize); Exit;',
                  "EndIf"]
    elif path.suffix.lower() in EXACT:
        lines.append(f"Mesh.MeshSizeFromCurvature = {around};")
    return "\n".join([*lines, ""])


def _sizes(points: Floats, cells: NDArray[np.int64], sizes: Floats) -> str:
    """The view of sizes at the corners of simplices, in gmsh's format of them."""
    kind = {3: "ST", 4: "SS"}[cells.shape[1]]
    rows = np.column_stack([points[cells].reshape(len(cells), -1), sizes[cells]])
    split = 3 * cells.shape[1]
    lines = (f"{kind}({','.join(f'{x:.9g}' for x in row[:split])}){{{','.join(f'{x:.6g}' for x in row[split:])}}};"
             for row in rows.tolist())
    return "\n".join(['View "sizes" {', *lines, "};"])

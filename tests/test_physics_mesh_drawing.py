"""Drawings that gmsh cuts into cells: volumes and units from their dimensions, names of their parts, and what a script may not do."""

import os
import shutil
import subprocess
import sys
import time
from math import pi
from pathlib import Path

import numpy as np
import pytest

from physics.flow.solution import solve_flow
from physics.mesh.build import build_mesh
from physics.mesh.files import read_mesh
from physics.mesh.formats.drawing import Cut
from physics.mesh.quality import cell_volumes
from physics.mesh.second import second_order
from physics.scene import Body, read_any
from physics.schema import InputError
from tests.scenes import beam

pytestmark = pytest.mark.skipif(shutil.which("gmsh") is None, reason="gmsh is not installed")

# An L of 80 x 60 x 20, 10 thick, with a hole of radius 5 through its foot: 16 000 + 10 000 - 250 pi.
BRACKET = """SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 80, 20, 10};
Box(2) = {0, 0, 0, 10, 20, 60};
Cylinder(3) = {60, 10, -10, 0, 0, 30, 5};
BooleanUnion(4) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
BooleanDifference(5) = { Volume{4}; Delete; }{ Volume{3}; Delete; };
"""
CORNER = """// plane, of sides 1 and 0.3
Point(1) = {0, 0, 0, 0.2}; Point(2) = {1, 0, 0, 0.2}; Point(3) = {1, 0.3, 0, 0.2};
Point(4) = {0.3, 0.3, 0, 0.2}; Point(5) = {0.3, 1, 0, 0.2}; Point(6) = {0, 1, 0, 0.2};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6}; Line(6) = {6, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6}; Plane Surface(1) = {1};
"""
NAMED = 'Physical Curve("top") = {5}; Physical Curve("right") = {2};\n'


def drawing(folder, text=CORNER, name="part.geo"):
    (folder / name).write_text(text)
    return folder / name


@pytest.fixture(scope="module")
def step(tmp_path_factory):
    """The bracket as a STEP file, which says that it is in millimetres."""
    folder = tmp_path_factory.mktemp("step")
    drawing(folder, BRACKET + 'Save "part.step";\n', "made.geo")
    subprocess.run(["gmsh", "made.geo", "-0", "-v", "1"], cwd=folder, check=True, capture_output=True)
    return folder / "part.step"


def volume(mesh):
    """By the rule of the cells, so with their curved sides."""
    from physics.body.element import samples
    return samples(mesh).volumes.sum()


EXACT = 26_000 - 250 * pi


def test_a_drawing_has_the_volume_of_its_dimensions_and_its_holes_are_round_at_second_order(tmp_path):
    path = drawing(tmp_path, BRACKET)
    first, second = read_mesh(path, cut=Cut(5.0)), second_order(read_mesh(path, order=2, cut=Cut(5.0)))
    np.testing.assert_allclose(np.ptp(first.points, axis=0), (80, 20, 60), rtol=1e-9)
    assert 10 < volume(first) - EXACT < 120  # the hole is a polygon of some eight sides, a tenth too small
    assert abs(volume(second) - EXACT) < 1.0


def test_step_says_its_units_and_a_script_has_metres_or_a_scale(step, tmp_path):
    in_metres, scaled = read_mesh(step), read_mesh(drawing(tmp_path, BRACKET), scale=1e-3)
    for mesh in (in_metres, scaled):
        np.testing.assert_allclose(np.ptp(mesh.points, axis=0), (0.08, 0.02, 0.06), rtol=1e-4)
        assert not mesh.remarks
    assert "in mm? then body.scale = 0.001" in read_mesh(drawing(tmp_path, BRACKET)).remarks[0]


@pytest.mark.parametrize("ending", ["geo", "step"])
def test_cells_have_the_size_asked_for_in_metres(ending, step, tmp_path):
    path, scale = (step, None) if ending == "step" else (drawing(tmp_path, BRACKET), 1e-3)
    meshes = [read_mesh(path, scale=scale, cut=Cut(size)) for size in (0.006, 0.003)]
    for mesh, size in zip(meshes, (0.006, 0.003), strict=True):
        each = cell_volumes(mesh.points, mesh.cells, "tetrahedron")
        assert 0.5 * size < np.median((6 * 2**0.5 * each) ** (1 / 3)) < 1.25 * size
    assert 4 < len(meshes[1].cells) / len(meshes[0].cells) < 12


def test_without_a_size_a_script_has_its_own_and_with_one_it_is_that(tmp_path):
    path = drawing(tmp_path)
    own, asked = (len(build_mesh(Body(shape="file", path=str(path), cell_size=size)).cells) for size in (None, 0.05))
    assert 20 < own < 60  # 0.51 in cells of (0.2)^2 sqrt(3) / 4: 29
    assert 350 < asked < 700  # 471


def test_parts_go_by_their_names_or_by_their_numbers(step, tmp_path):
    assert sorted(read_mesh(step).places) == ["body", *(f"surface-{i}" for i in range(1, 10))]
    plain, named = read_mesh(drawing(tmp_path)), read_mesh(drawing(tmp_path, CORNER + NAMED, "named.geo"))
    assert sorted(plain.places) == ["body", *(f"curve-{i}" for i in range(1, 7))]
    assert sorted(named.places) == ["body", "right", "top"]
    for mesh, place in ((plain, "curve-2"), (named, "right")):
        np.testing.assert_allclose(mesh.points[mesh.places[place], 0], 1.0)
    held = read_mesh(drawing(tmp_path, BRACKET + 'Physical Surface("held") = {1};', "held.geo"))
    assert sorted(held.places) == ["body", "held"] and held.cell == "tetrahedron"


def test_a_script_may_merge_a_drawing_beside_it(step, tmp_path):
    (tmp_path / "part.step").write_bytes(step.read_bytes())
    mesh = read_mesh(drawing(tmp_path, 'SetFactory("OpenCASCADE"); Merge "part.step";\nPhysical Surface("held") = {1};\n', "with.geo"))
    assert sorted(mesh.places) == ["body", "held"]


def test_the_same_drawing_gives_the_same_cells(step):
    one, other = read_mesh(step), read_mesh(step)
    assert one.points.tobytes() == other.points.tobytes() and one.cells.tobytes() == other.cells.tobytes()


@pytest.mark.parametrize("line, said", [
    ('SystemCall "touch {}";', "line 6: SystemCall is not followed"),
    ('NonBlockingSystemCall "touch {}";', "NonBlockingSystemCall is not"),
    ('Save "{}";', "Save is not"),
    ('Print "{}";', "Print is not"),
    ('Printf("x") > "{}";', "writes to a file"),
    ('Printf("x") >> "{}";', "writes to a file"),
    ('Include "{}";', "Include is not"),
    ('Merge "{}";', "Merge of"),
    ('Merge "../part.step";', "Merge of"),
    ('Merge StrCat("part", ".step");', "Merge of no plain name"),
    ('Merge "away.step";', "Merge of away.step: no such file"),
    ('Field[1] = ExternalProcess; Field[1].CommandLine = "touch {}";', "ExternalProcess is not"),
    ('OnelabRun("x", "touch {}");', "OnelabRun is not"),
    ('CreateDir "{}";', "CreateDir is not"),
    ('General.ErrorFileName = "{}";', "General is not"),
    ('Plugin(MathEval).Run;', "Plugin is not"),
    ('x() = ListFromFile["{}"];', "ListFromFile is not"),
    ('Field[1] = Structured; Field[1].FileName = "{}";', "FileName is not"),
    ('x = "a\nb"; SystemCall "touch {}";', "line 6: a text or comment that does not end"),
    ("""x = '"'; SystemCall "touch {}";""", "line 6: SystemCall is not"),
    ("x = '/*'; SystemCall 'touch {}'; y = '*/';", "SystemCall is not"),
    ("""x = "\\" '"; SystemCall "touch {}"; y = "'";""", "a text or comment that does not end"),
    ("x = '" + 9999 * "a" + "'; y = \"SystemCall 'touch {}'; z = \";", "is too long"),
    ("""If (0)\nx = " EndIf SystemCall 'touch {}'; x = ";\nEndIf""", "line 7: EndIf within a text"),
    ('\u00e9SystemCall "touch {}";', "SystemCall is not"),
    ('x = "\0"; SystemCall "touch {}";', "a byte that no text has"),
    ('/* \n\n */ SystemCall "touch {}";', "line 8: SystemCall is not"),
])
def test_a_script_that_does_more_than_draw_is_refused_unread(line, said, tmp_path):
    path = drawing(tmp_path, CORNER.strip() + "\n" + line.replace("{}", str(tmp_path / "made")) + "\n")
    with pytest.raises(InputError, match="part.geo: ") as error:
        read_mesh(path)
    assert said in str(error.value) and "\n" not in str(error.value) and not (tmp_path / "made").exists()


def test_words_in_comments_and_names_run_nothing(tmp_path):
    text = CORNER + '// SystemCall "x";\n/* Save "y";\nPrint */\nPhysical Curve("Save // this") = {1};\nPrintf("Print %g", 1);\n'
    assert "Save // this" in read_mesh(drawing(tmp_path, text)).places


@pytest.mark.parametrize("name", ["part.Step", "part.Igs", "part.Brep", "part.step"])
def test_an_ending_in_large_letters_makes_no_drawing_a_script(name, tmp_path):
    path = drawing(tmp_path, CORNER + f'SystemCall "touch {tmp_path / "made"}";\n', name)
    with pytest.raises(InputError):
        read_mesh(path)
    with pytest.raises(InputError):
        read_mesh(drawing(tmp_path, f'Merge "{name}";'))
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("name", ["-3.geo", "cut here.geo", "cut.geo", "\u00fc 'b'.GEO"])
def test_a_drawing_may_have_any_name(name, tmp_path, monkeypatch):
    drawing(tmp_path, name=name)
    monkeypatch.chdir(tmp_path)
    assert "curve-2" in read_mesh(name).places


def test_texts_are_in_either_quotes(tmp_path):
    text = CORNER + """Physical Curve("It's // held \u00e9") = {1};\nIf (1) Physical Curve('x y') = {2}; Else x = 1; EndIf\n"""
    assert sorted(read_mesh(drawing(tmp_path, text)).places) == ["It's // held \u00e9", "body", "x y"]


def iges(unit):
    """A rectangle of 100 x 50 between two lines, as an IGES file in a unit by its number and name in IGES 5.3."""
    head = ("1H,,1H;,4Htest,8Htest.igs,4Htest,4Htest,32,38,6,308,15,4Htest,1.," + unit +
            ",1,1.,15H20200101.000000,1E-07,100.,4Htest,4Htest,11,0,15H20200101.000000;")
    heads = [head[i:i + 72] for i in range(0, len(head), 72)]
    lines = [f"{'test':<72}S{1:>7}", *(f"{one:<72}G{i:>7}" for i, one in enumerate(heads, 1))]
    entities = [(110, "110,0.,0.,0.,100.,0.,0.;"), (110, "110,0.,50.,0.,100.,50.,0.;"), (118, "118,1,3,0,0;")]
    for i, (kind, _) in enumerate(entities):
        status = "00010000" if kind == 110 else "00000000"
        lines += [f"{kind:>8}{i + 1:>8}" + f"{0:>8}" * 6 + f"{status}D{2 * i + 1:>7}",
                  f"{kind:>8}{0:>8}{0:>8}{1:>8}{int(kind == 118):>8}{'':>24}{0:>8}D{2 * i + 2:>7}"]
    lines += [f"{said:<64}{2 * i + 1:>8}P{i + 1:>7}" for i, (_, said) in enumerate(entities)]
    return "\n".join([*lines, f"S{1:>7}G{len(heads):>7}D{6:>7}P{3:>7}{'':>40}T{1:>7}\n"])


@pytest.mark.parametrize("unit, metre", [("2,2HMM", 1e-3), ("6,1HM", 1.0), ("1,4HINCH", 0.0254)])
def test_iges_says_its_units_too(unit, metre, tmp_path):
    path = drawing(tmp_path, iges(unit), "part.IGES")
    mesh = read_mesh(path, cut=Cut(10 * metre))
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), (100 * metre, 50 * metre, 0), rtol=1e-9)
    assert 80 < len(mesh.cells) < 200  # 50 squares of 10 in two triangles and more


def test_a_torus_has_as_many_cells_around_it_as_keep_its_sides_from_crossing(tmp_path):
    path = drawing(tmp_path, 'SetFactory("OpenCASCADE"); Torus(1) = {0, 0, 0, 0.02, 0.005};')
    mesh = second_order(read_mesh(path, order=2, cut=Cut(0.004)))
    assert volume(mesh) == pytest.approx(2 * pi**2 * 0.02 * 0.005**2, rel=1e-3)


def test_gmsh_ends_with_the_program_that_waits_for_it(tmp_path):
    path = drawing(tmp_path, CORNER + "For i In {0:1e12}\nx = i;\nEndFor\n")
    program = f"import os, sys; sys.path[:] = {sys.path!r}; from physics.mesh.files import read_mesh; read_mesh({str(path)!r})"
    with subprocess.Popen([sys.executable, "-c", program], env=os.environ | {"TMPDIR": str(tmp_path)}) as waiting:
        while not list(tmp_path.glob("fidelity-drawing-*/said")):
            time.sleep(0.05)
        time.sleep(0.5)
        waiting.kill()
    at = [link for link in Path("/proc").glob("[0-9]*/cwd") if os.access(link, os.R_OK) and str(tmp_path) in os.path.realpath(link)]
    for _ in range(50):
        if not any(str(tmp_path) in os.path.realpath(link) for link in at if link.exists()):
            return
        time.sleep(0.1)
    pytest.fail("gmsh runs on")


def test_no_options_beside_a_drawing_or_at_home_are_followed(tmp_path, monkeypatch):
    drawing(tmp_path)
    command = f'SystemCall "touch {tmp_path / "made"}";\nMesh.MeshSizeMax = 0.01;\n'
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("part.geo.opt", ".gmshrc", ".gmsh-options"):
        drawing(tmp_path, command, name)
    assert len(read_mesh(tmp_path / "part.geo").cells) < 60 and not (tmp_path / "made").exists()


@pytest.mark.parametrize("name, text, said", [
    ("no.step", "nothing", "gmsh cannot cut it into cells"),
    ("no.geo", "Point(1) = {0, 0;", "gmsh cannot cut it into cells"),
    ("no.geo", "Point(1) = {0, 0, 0};", "no.geo: "),
    ("no.geo", "", "draws nothing that could be cut into cells"),
])
def test_what_cannot_be_meshed_is_said_in_one_line(name, text, said, tmp_path):
    with pytest.raises(InputError) as error:
        read_mesh(drawing(tmp_path, text, name))
    assert said in str(error.value)
    assert "\n" not in str(error.value) and str(error.value).startswith(str(tmp_path / name))


def test_cells_far_too_small_are_refused_before_they_are_made(tmp_path):
    with pytest.raises(InputError, match=r"cells of 1e-05 along a diagonal of 1\.41"):
        read_mesh(drawing(tmp_path), cut=Cut(1e-5))


def test_without_gmsh_a_drawing_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="gmsh is not installed: apt-get install gmsh"):
        read_mesh(drawing(tmp_path))


def test_only_a_drawing_takes_a_cell_size():
    with pytest.raises(InputError, match=r"body\.cell_size: a file takes path, scale, shape, order"):
        beam(body={"shape": "file", "path": "part.msh", "cell_size": 0.1})
    assert beam(body={"shape": "file", "path": "part.geo", "cell_size": 0.1}).body.drawn


def test_sizes_near_points_are_followed(tmp_path):
    """0.1 at x = 0 and 0.02 at x = 1, on two triangles that cover the corner."""
    path = drawing(tmp_path)
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    mesh = read_mesh(path, cut=Cut(near=(points, np.array([(0, 1, 2), (0, 2, 3)]), np.array([0.1, 0.02, 0.02, 0.1]))))
    size = (4 / 3**0.5 * cell_volumes(mesh.points, mesh.cells, "triangle")) ** 0.5
    x = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    assert 0.8 < np.median(size[x < 0.1]) / 0.095 < 1.2 and 0.8 < np.median(size[x > 0.9]) / 0.024 < 1.2


def test_a_plane_drawing_is_a_domain_of_flow(tmp_path):
    """Schäfer and Turek's benchmark 2D-1, the channel cut off at 1 m: a drag coefficient of 5.5795 (Nabh 1998)."""
    channel = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 0.41}; Disk(2) = {0.2, 0.2, 0, 0.05};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
"""
    scene = read_any({"body": {"shape": "file", "path": str(drawing(tmp_path, channel)), "cell_size": 0.02},
                      "fluid": {"density": 1.0, "viscosity": 1e-3}, "inflow": [{"where": "curve-2", "profile": "parabola", "speed": 0.3}],
                      "outflow": [{"where": "curve-3"}], "force": {"where": "curve-5", "speed": 0.2, "length": 0.1},
                      "steps": {"stationary": True}})
    assert solve_flow(scene).coefficients("drag")[-1] == pytest.approx(5.5795, rel=5e-3)

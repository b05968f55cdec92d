"""`fidelity modes` from the shell: two processes, pictures, files, wrong inputs."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

import fidelity
from physics.modes.elastic import elastic_modes
from physics.schema import InputError
from physics.solution import solve
from tests.scenes import beam

ROOT = Path(__file__).parent.parent
SLENDER = {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [40, 5, 5]}


def mpirun(*arguments):
    environment = {key: value for key, value in os.environ.items() if not key.startswith("OMPI_")} | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_plm": "isolated", "OMP_NUM_THREADS": "1",
        "HWLOC_HIDE_ERRORS": "2", "OMPI_MCA_rmaps_base_oversubscribe": "1"}
    command = ["mpirun", "-n", "2", sys.executable, str(ROOT / "fidelity.py"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)


@pytest.mark.skipif(not shutil.which("mpirun"), reason="no mpirun")
@pytest.mark.parametrize("body, material, arguments", [
    ('length = 0.1\nwidth = 0.02\nheight = 0.02\ncells = [20, 4, 4]', True, []),
    ('length = 0.1\nwidth = 0.02\nheight = 0.02\ncells = [8, 2, 2]\ncell = "tetrahedron"\norder = 2', True, []),
    ('shape = "channel"\norder = 2', False, ["--kind", "laplacian"]),
])
def test_two_processes_give_the_same(tmp_path, body, material, arguments):
    scene = tmp_path / "scene.toml"
    scene.write_text(f"[body]\n{body}\n" + ("[material]\nyoung_modulus = 1e6\npoisson_ratio = 0.4\n[[support]]\n"
                                           'where = "x-min"\nfixed = "xyz"\n' if material else ""))
    arguments = ["modes", scene, *arguments, "--count", "5", "--json", "--out"]
    two = mpirun(*arguments, tmp_path / "two.vtu")
    assert two.returncode == 0, two.stderr
    one = subprocess.run([sys.executable, ROOT / "fidelity.py", *map(str, arguments), tmp_path / "one.vtu"], capture_output=True, text=True)
    two, one = json.loads(two.stdout), json.loads(one.stdout)
    key = "eigenvalues" if "eigenvalues" in one else "frequencies_hz"
    assert two[key] == pytest.approx(one[key], rel=1e-9) and max(two["residuals"]) < 1e-8
    assert two["dofs"] == one["dofs"]
    # The shapes are put together in the order of the mesh; the third has no equal.
    shapes = [meshio.read(tmp_path / name).point_data["mode_3"] for name in ("one.vtu", "two.vtu")]
    assert abs(np.vdot(*shapes)) == pytest.approx(np.vdot(shapes[0], shapes[0]), rel=1e-6)


def test_pictures_and_trajectory_file(tmp_path, capsys):
    from datagen.files.trajectory import problems, read_trajectory

    scene = tmp_path / "scene.toml"
    scene.write_text(beam(body={**SLENDER, "cells": [8, 2, 2]}).to_toml())
    arguments = ["modes", scene, "--count", "2", "--out", tmp_path / "modes.vtkhdf", "--picture", tmp_path / "pictures", "--json"]
    assert fidelity.main([str(argument) for argument in arguments]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["pictures"] == ["mode_01.png", "mode_01.gif", "mode_02.png", "mode_02.gif"]
    from PIL import Image

    with Image.open(tmp_path / "pictures" / "mode_01.gif") as film:
        assert film.n_frames >= 10 and film.size[0] == 600
    trajectory = read_trajectory(tmp_path / "modes.vtkhdf")
    assert not problems(trajectory) and trajectory.modes.shape == (2, 81, 3)
    assert trajectory.frequencies_hz == pytest.approx(result["frequencies_hz"])


WRONG = [
    ("body.order", {"body": {**SLENDER, "order": 2}}, "prisms are of first order only"),
    ("plane beam", {"body": {**SLENDER, "cell": "triangle"}}, "a beam has prism or tetrahedron or hexahedron cells"),
    ("file without path", {"body": {"shape": "file"}}, "body.path: missing"),
    ("length of a file", {"body": {"shape": "file", "path": "x.msh", "length": 1.0}}, "body.length: a file takes path"),
    ("hole outside", {"body": {"shape": "channel", "hole_centre": [0.0, 0.2]}}, "does not lie inside the channel"),
    ("height of a plane plate", {"body": {"shape": "plate", "length": 1, "width": 1, "height": 1, "cells": [2, 2], "cell": "triangle"}},
     "body.height: a plane plate takes"),
    ("edge that is none", {"support": [{"where": "x-min z-mid"}]}, "did you mean 'z-min'?"),
    ("no such shape", {"body": {"shape": "sphere"}}, "must be one of beam, plate, channel, panel, file"),
]


@pytest.mark.parametrize("changes, words", [case[1:] for case in WRONG], ids=[case[0] for case in WRONG])
def test_wrong_bodies_are_refused(changes, words):
    with pytest.raises(InputError, match=words.replace("?", r"\?")):
        beam(**changes)


def test_faces_that_do_not_meet_are_refused():
    with pytest.raises(InputError, match="no node in common"):
        elastic_modes(beam(support=[{"where": "x-min x-max"}]))


def test_dirichlet_is_for_laplacian_modes(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(beam().to_toml())
    assert fidelity.main(["modes", str(scene), "--dirichlet", "x-min"]) == 2
    assert "--dirichlet is for" in capsys.readouterr().err


def test_modes_at_a_frame_are_those_of_the_loaded_body(tmp_path, capsys):
    """A beam pulled by 5 % of its length: the frame that `simulate` wrote gives what Python does; what is no such frame is refused."""
    pulled = beam(body={"length": 0.06, "width": 0.01, "height": 0.005, "cells": [8, 1, 2]}, steps={"count": 2},
                  support=[{"where": "x-min"}, {"where": "x-max", "displacement": [0.003, 0, 0]}])
    scene, path = tmp_path / "pulled.toml", tmp_path / "pulled.vtkhdf"
    scene.write_text(pulled.to_toml())
    assert fidelity.main(["simulate", str(scene), "--out", str(path)]) == 0
    capsys.readouterr()
    assert fidelity.main(["modes", str(scene), "--at", f"{path}:2", "--count", "2", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    solution = solve(pulled)
    expected = elastic_modes(pulled, count=2, at=(solution.displacement[-1], 1.0)).frequencies_hz
    assert result["frequencies_hz"] == pytest.approx(expected, rel=1e-6) and "of the body as it is at 1" in result["remarks"][0]
    assert result["frequencies_hz"][0] > 1.2 * elastic_modes(pulled, count=1).frequencies_hz[0]
    other = tmp_path / "other.toml"
    other.write_text(beam().to_toml())
    for arguments, said in ((["modes", scene, "--at", f"{path}:3"], "has frames 0 .. 2"),
                            (["modes", scene, "--at", path], "the number of a frame"),
                            (["modes", other, "--at", f"{path}:1"], "not a trajectory of this scene"),
                            (["modes", scene, "--at", f"{scene}:1"], "not a whole trajectory file"),
                            (["modes", scene, "--kind", "laplacian", "--at", f"{path}:1"], "--at is for elastic modes")):
        assert fidelity.main([str(argument) for argument in arguments]) == 2
        assert said in (err := capsys.readouterr().err) and err.count("\n") == 1

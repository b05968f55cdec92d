"""Scene files: what is right is read and written back unchanged, what is wrong ends in one line that says what."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from physics.scene import load_scene, read_scene
from physics.schema import InputError

ROOT = Path(__file__).parent.parent
GOOD = """
name = "press"
[body]
length = 0.1
width = 0.02
height = 0.02
cells = [4, 2, 2]
[material]
young_modulus = 1e6
poisson_ratio = 0.4
[[support]]
where = "x-min"
fixed = "xyz"
[obstacle]
shape = "cylinder"
radius = 0.01
path = [[0.08, 0.01, 0.031], [0.08, 0.01, 0.03]]
[steps]
count = 2
"""

# Each: what is replaced, by what, and words of the message. One for every kind of mistake.
WRONG = {
    "missing key": ("length = 0.1", "", "body.length: missing"),
    "missing table": ("[material]\nyoung_modulus = 1e6\npoisson_ratio = 0.4", "", "material: missing"),
    "unknown key": ("length = 0.1", "lenght = 0.1", "body.lenght: unknown key; did you mean 'length'?"),
    "key of another shape": ("length = 0.1", "file = 'a.msh'", "body.file: unknown key; body takes shape, length, width,"),
    "unknown table": ("[steps]", "[stepz]", "stepz: unknown key; did you mean 'steps'?"),
    "wrong type": ("length = 0.1", 'length = "long"', "body.length must be a number, not a string"),
    "not whole": ("count = 2", "count = 2.5", "steps.count must be an integer, not a number"),
    "boolean": ("count = 2", "count = true", "steps.count must be an integer, not a boolean"),
    "table expected": ("[steps]\ncount = 2", "", None),
    "nan": ("length = 0.1", "length = nan", "body.length = nan: must be finite"),
    "infinite": ("young_modulus = 1e6", "young_modulus = inf", "must be finite"),
    "negative length": ("length = 0.1", "length = -0.1", "body.length = -0.1: must be above 0 m"),
    "zero radius": ("radius = 0.01", "radius = 0.0", "obstacle.radius = 0.0: must be above 0 m"),
    "no cells": ("cells = [4, 2, 2]", "cells = [4, 0, 2]", "must be at least 1"),
    "two cells": ("cells = [4, 2, 2]", "cells = [4, 2]", "body.cells must have 3 entries, not 2"),
    "cells twice": ("cells = [4, 2, 2]", "cells = [4, 2, 2]\ncell_size = 0.01", "exactly one of cells and cell_size"),
    "far too many cells": ("cells = [4, 2, 2]", "cell_size = 1e-6", "cells are more than"),
    "next to nothing": ("young_modulus = 1e6", "young_modulus = 1e-300", "must be at least 1e-09 Pa"),
    "astronomical": ("length = 0.1", "length = 1e300", "must be at most 1e+09 m"),
    "incompressible": ("poisson_ratio = 0.4", "poisson_ratio = 0.5", "must be below 0.5"),
    "unknown law": ("young_modulus = 1e6", 'young_modulus = 1e6\nlaw = "neohookean"', "did you mean 'neo-hookean'?"),
    "unknown place": ('where = "x-min"', 'where = "left"', "must be one of x-min"),
    "unknown letter": ('fixed = "xyz"', 'fixed = "xw"', "must be some of the letters x, y and z"),
    "moved but free": ('fixed = "xyz"', 'fixed = "xy"\ndisplacement = [0, 0, 1e-3]', "which fixed = 'xy' leaves free"),
    "rigid motion": ('fixed = "xyz"', 'fixed = "x"', "rigid motions of the body left free"),
    "no support": ('[[support]]\nwhere = "x-min"\nfixed = "xyz"', "", "6 rigid motions"),
    "starts inside": ("[0.08, 0.01, 0.031]", "[0.08, 0.01, 0.02]", "inside the body"),
    "no path": ("path = [[0.08, 0.01, 0.031], [0.08, 0.01, 0.03]]", "path = []", "at least one way-point"),
    "no axis": ("radius = 0.01", "radius = 0.01\naxis = [0, 0, 0]", "must not be the zero vector"),
    "no radius": ("radius = 0.01", "", "obstacle.radius: missing; a cylinder needs it"),
    "no length": ('shape = "cylinder"', 'shape = "capsule"', "obstacle.length: missing"),
    "length of a cylinder": ("radius = 0.01", "radius = 0.01\nlength = 0.1", "obstacle.length: a cylinder has none"),
    "round box": ('shape = "cylinder"', 'shape = "box"\nsize = [0.01, 0.02, 0.03]', "at most 0.005 m"),
    "supports that contradict": ("[obstacle]", '[[support]]\nwhere = "z-max"\nfixed = "z"\ndisplacement = [0, 0, -1e-3]\n[obstacle]',
                                 "another support gives another"),
    "load of both kinds": ("[steps]", '[[load]]\nwhere = "x-max"\ntraction = [0, 0, 1]\nacceleration = [0, 0, 1]\n[steps]', "exactly one"),
    "load nowhere": ("[steps]", "[[load]]\ntraction = [0, 0, 1]\n[steps]", "needs a where"),
    "not TOML": ("[body]", "[body", "not a TOML file"),
    "400 digits": ("length = 0.1", f"length = 1{'0' * 400}", "body.length = (an integer of 1329 bits): must be finite"),
    "400 digits where a whole number is": ("count = 2", f"count = 1{'0' * 400}", "an integer of 1329 bits): must be at most 1e+06"),
    "5000 digits": ("count = 2", f"count = 1{'0' * 5000}", "not a TOML file"),
    "5000 hexadecimal digits": ("count = 2", f"count = 0x1{'0' * 5000}", "an integer of 20001 bits"),
    "20 000 brackets": ('name = "press"', f"name = {'[' * 20_000}", "nested too deeply"),
    "a byte-order mark": ('\nname = "press"', '\ufeffname = "press"', "begins with a byte-order mark"),
    "an axis of next to nothing": ("radius = 0.01", "radius = 0.01\naxis = [0, 1e-300, 0]", "length must be from 1e-9 to 1e9"),
    "an axis beyond everything": ("radius = 0.01", "radius = 0.01\naxis = [0, 1e300, 1e300]", "length must be from 1e-9 to 1e9"),
    "an astronomical path": ("[0.08, 0.01, 0.03]]", "[0.08, 0.01, 1e300]]", "obstacle.path = 1e+300: must be at most 1e+09 m"),
    "a path to the moon": ("[0.08, 0.01, 0.03]]", "[0.08, 0.01, 1e9]]", "times what the obstacle may move at once"),
    "an astronomical load": ("[steps]", '[[load]]\nwhere = "x-max"\ntraction = [0, 0, 1e300]\n[steps]', "must be at most 1e+18 Pa"),
    "a load far stronger than the body": ("[steps]", '[[load]]\nwhere = "x-max"\ntraction = [0, 0, 1e15]\n[steps]',
                                          "times Young's modulus"),
    "a weight far stronger than the body": ("[steps]", "[[load]]\nacceleration = [0, 0, -1e17]\n[steps]", "times Young's modulus"),
    "a pressure far stronger than the body": ("[steps]", '[[load]]\nwhere = "x-max"\npressure = -1e15\n[steps]', "times Young's modulus"),
    "a table that makes a load far too strong": (
        "[steps]", '[[load]]\nwhere = "x-max"\ntraction = [0, 0, 10]\nsteps = [0, 0.5, 1]\nfactor = [0, -1e9, 0]\n[steps]',
        "load[0]: 1e+10 Pa are 1e+04 times Young's modulus"),
    "a name of 300 letters": ('name = "press"', f'{"n" * 300} = "press"', "unknown key"),
}


def test_scene_is_read_and_written_back_unchanged():
    scene = read_scene(tomllib.loads(GOOD))
    assert scene.body.length == 0.1 and scene.obstacle.contact == "facets" and scene.material.density == 1000.0
    assert read_scene(tomllib.loads(scene.to_toml())) == scene


@pytest.mark.parametrize("kind", [kind for kind, case in WRONG.items() if case[2]])
def test_wrong_scenes_end_with_one_line_and_status_2(kind, tmp_path, capsys):
    import fidelity

    old, new, words = WRONG[kind]
    assert old in GOOD
    (tmp_path / "scene.toml").write_text(GOOD.replace(old, new))
    status = fidelity.main(["simulate", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "t.vtkhdf"), "--json"])
    out, err = capsys.readouterr()
    assert status == 2 and out == ""
    assert err.count("\n") == 1 and words in err
    assert not (tmp_path / "t.vtkhdf").exists()


def test_what_may_be_left_out_may_be_left_out():
    old, new, _ = WRONG["table expected"]
    assert read_scene(tomllib.loads(GOOD.replace(old, new))).steps.count == 400


def test_missing_and_binary_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        load_scene(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a TOML file"):
        load_scene(tmp_path / "binary.toml")


def test_from_the_shell(tmp_path):
    """Once through a real process: nothing but the line on standard error, nothing on standard output."""
    (tmp_path / "scene.toml").write_text(GOOD.replace("length = 0.1", "length = -0.1"))
    run = subprocess.run([sys.executable, ROOT / "fidelity.py", "modes", tmp_path / "scene.toml"], capture_output=True, text=True)
    assert run.returncode == 2 and run.stdout == ""
    assert run.stderr == f"fidelity: {tmp_path / 'scene.toml'}: body.length = -0.1: must be above 0 m\n"


def test_file_names_that_are_too_long_are_wrong_input(tmp_path, capsys):
    import fidelity

    (tmp_path / "scene.toml").write_text(GOOD)
    long = tmp_path / ("n" * 300)
    for command in (["modes", f"{long}.toml"], ["simulate", tmp_path / "scene.toml", "--out", f"{long}.vtkhdf"],
                    ["verify", long, "--reference", long], ["dataset", "unpack", long, "--out", tmp_path / "x"],
                    ["dataset", "check", long]):
        assert fidelity.main([str(word) for word in command]) == 2
        assert capsys.readouterr().err.count("File name too long") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]

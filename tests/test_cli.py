"""The command line, as a user types it: the whole line on tiny scenes, JSON, exit statuses."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOHDF import vtkHDFReader

import fidelity
from datagen.files.trajectory import read_trajectory, write_trajectory
from tests.synthetic import bending

ROOT = Path(__file__).parent.parent
SCENE = """
[body]
length = 0.06
width = 0.02
height = 0.02
cells = [6, 2, 2]
[material]
young_modulus = 1e6
poisson_ratio = 0.4
[[support]]
where = "x-min"
fixed = "xyz"
[obstacle]
shape = "cylinder"
radius = 0.01
path = [[0.05, 0.01, 0.0305], [0.05, 0.01, 0.02]]
[steps]
count = 10
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def run(capsys, *arguments):
    status = fidelity.main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return status, out, err


def run_json(capsys, *arguments):
    status, out, err = run(capsys, *arguments, "--json")
    assert status == 0, err
    assert out.count("\n") == 1
    return json.loads(out)


def test_segments_of_a_file(capsys, tmp_path):
    path = tmp_path / "bent.vtkhdf"
    write_trajectory(path, bending())
    before = path.read_bytes()
    for wrong, words in ((["--method", "slic"], "did you mean"), (["--tau", "-1"], "tau = -1"), (["--mode-count", "3"], "2 of the 3 modes"),
                         (["--picture", tmp_path / "s.gif"], "must end in .png")):
        status, _, error = run(capsys, "segment", path, *wrong)
        assert status == 2 and words in error and path.read_bytes() == before
    result = run_json(capsys, "segment", path, "--segments", "auto", "--method", "slic-md", "--picture", tmp_path / "s.png")
    best = max(result["silhouette_of"], key=result["silhouette_of"].get)
    assert result["segments"] == int(best) and (tmp_path / "s.png").stat().st_size > 1000
    label = read_trajectory(path).segment
    assert label is not None and label.max() == result["segments"]  # the obstacle's


def test_modes(capsys, scene, tmp_path):
    import meshio

    result = run_json(capsys, "modes", scene, "--count", "3", "--out", tmp_path / "modes.vtu")
    assert result["kind"] == "elastic" and len(result["frequencies_hz"]) == 3 and max(result["residuals"]) < 1e-8
    assert result["dofs"] == 6 * 9 * 3
    assert set(meshio.read(tmp_path / "modes.vtu").point_data) == {"mode_1", "mode_2", "mode_3"}


def test_simulate_writes_what_vtk_and_h5py_read_alike(capsys, scene, tmp_path):
    out = tmp_path / "t.vtkhdf"
    result = run_json(capsys, "simulate", scene, "--out", out)
    assert result["steps"] == 10 == len(result["reaction"])
    assert result["largest_relative_residual"] < 1e-6 and result["smallest_det_f"] > 0 and result["factorisations"] > 0
    with h5py.File(out) as file:
        stored = file["VTKHDF/PointData/displacement"][()].reshape(11, -1, 3)
        points, energy = file["VTKHDF/Points"][()], file["VTKHDF/FieldData/energy"][()]
    reader = vtkHDFReader()
    reader.SetFileName(str(out))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 11
    for step in range(11):
        reader.SetStep(step)
        reader.Update()
        grid = reader.GetOutputDataObject(0)
        assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData()), points)
        assert np.array_equal(vtk_to_numpy(grid.GetPointData().GetArray("displacement")), stored[step])
        assert vtk_to_numpy(grid.GetFieldData().GetArray("energy"))[0] == energy[step]


def test_a_failed_simulation_keeps_its_steps(capsys, scene, tmp_path):
    from datagen.files.trajectory import read_trajectory

    squeezed = SCENE.replace("count = 10", "count = 4").replace(SCENE[SCENE.index("[obstacle]"):SCENE.index("[steps]")], "")
    squeezed = squeezed.replace("x-min", "z-min")  # between its faces it is pressed flat, and further
    squeezed = squeezed.replace("[[support]]", '[[support]]\nwhere = "z-max"\nfixed = "xyz"\ndisplacement = [0, 0, -0.03]\n[[support]]')
    scene.write_text(squeezed)
    status, out, err = run(capsys, "simulate", scene, "--out", tmp_path / "t.vtkhdf", "--json")
    assert status == 1 and out == "" and err.splitlines()[-1].startswith("fidelity: no equilibrium at step")
    kept = read_trajectory(tmp_path / "t.vtkhdf")
    assert not kept.complete and 1 <= len(kept.displacement) < 5
    assert f"the {len(kept.displacement) - 1} steps before it are in" in err


def test_the_line_from_family_to_rollout(capsys, tmp_path):
    small = SCENE.replace("length = 0.06", "length = { uniform = [0.05, 0.06] }").replace("count = 10", "count = 4")
    small = small.replace("[0.05, 0.01, 0.0305], [0.05, 0.01, 0.02]", "[0.045, 0.01, 0.0305], [0.045, 0.01, 0.025]")
    (tmp_path / "family.toml").write_text(small + "[splits]\ntrain = 1\nvalid = 1\ntest = 1\n")
    data, trained = tmp_path / "data", tmp_path / "run"
    run_json(capsys, "generate", tmp_path / "family.toml", "--out", data, "--workers", "1")
    assert run(capsys, "dataset", "check", data)[0] == 0
    first = data / "train" / "0000.vtkhdf"
    result = run_json(capsys, "segment", first, "--segments", "4")
    assert len(result["nodes"]) == 4 == result["segments"] and sum(result["nodes"]) == 7 * 3 * 3 and min(result["nodes"]) > 0
    assert run(capsys, "dataset", "check", data)[0] == 0  # segments are no part of what is checked
    (tmp_path / "config.toml").write_text("segments = 4\nsteps = 4\nbatch_size = 1\nvalidate_every = 2\n[network]\nhidden = 8\n"
                                          "message_steps = 1\ntransformer_layers = 1\nheads = 2\n")
    result = run_json(capsys, "train", tmp_path / "config.toml", "--data", data, "--out", trained, "--steps", "2")
    assert result["steps"] == 2
    result = run_json(capsys, "train", tmp_path / "config.toml", "--data", data, "--out", trained, "--resume")
    assert result["steps"] == 4
    truth = read_trajectory(first)

    def apart(path):
        """Root mean square distance of free nodes over all steps, by plain loops."""
        other = read_trajectory(path)
        squares = [float(np.sum((other.displacement[t, i].astype(float) - truth.displacement[t, i]) ** 2))
                   for t in range(1, 5) for i in np.flatnonzero(truth.free)]
        return np.sqrt(np.mean(squares))

    result = run_json(capsys, "rollout", trained, first, "--out", tmp_path / "p.vtkhdf")
    assert result["steps"] == 4 and result["rmsd_all"] == pytest.approx(apart(tmp_path / "p.vtkhdf"), rel=1e-5)
    better = run_json(capsys, "rollout", trained, first, "--out", tmp_path / "c.vtkhdf", "--correct", "3")
    assert better["rmsd_all"] < 0.01 * result["rmsd_all"]  # however little the network has learned
    verified = run_json(capsys, "verify", tmp_path / "p.vtkhdf", "--reference", first, "--out", tmp_path / "verified")
    assert verified["rmsd_all"] == pytest.approx(result["rmsd_all"], rel=1e-5)
    assert verified["rmsd_all"] == pytest.approx(run_json(capsys, "verify", tmp_path / "p.vtkhdf", "--reference", first)["rmsd_all"])
    assert {"rmsd_1_all_nodes", "gf_h", "energy_error", "reaction_error", "estimated_error", "worst_step"} <= verified.keys()
    assert (tmp_path / "verified" / "worst.png").stat().st_size > 1000
    result = run_json(capsys, "view", tmp_path / "p.vtkhdf", "--out", tmp_path / "film.gif")
    assert result["pictures"] == 5 and (tmp_path / "film.gif").stat().st_size > 5_000
    result = run_json(capsys, "pareto", data, "--run", trained, "--out", tmp_path / "pareto", "--split", "train", "--count", "1",
                      "--repeats", "1", "--refined", "0")
    scores = {row["name"]: row["scores"] for row in result["rows"]}
    assert {"M4GN", "M4GN, corrected 10-fold", "M4GN, as the start of Newton", "reduced-order model"} <= scores.keys()
    assert scores["M4GN"]["rmsd_all"] == pytest.approx(apart(tmp_path / "p.vtkhdf"), rel=1e-3)  # float32, on another number of threads
    assert result["outside"].keys() == {"0000"} and (tmp_path / "pareto" / "table.csv").exists()
    with h5py.File(first, "r+") as file:  # of the last frame a free node
        file["VTKHDF/PointData/displacement"][4 * len(truth.points) + np.flatnonzero(truth.free)[20], 2] += 1e-3
    status, _, err = run(capsys, "dataset", "check", data)
    assert status == 1 and "0000.vtkhdf" in err
    status, out, err = run(capsys, "dataset", "check", data, "--json")
    assert status == 1 and "0000.vtkhdf" in json.loads(out)["problems"][0]
    assert run(capsys, "rollout", trained, data / "test" / "0000.vtkhdf", "--out", data / "test" / "0000.vtkhdf")[0] == 2


def test_a_data_set_by_its_verbs(capsys, tmp_path):
    family, data, packed = tmp_path / "family.toml", tmp_path / "data", tmp_path / "data.pack"
    family.write_text(SCENE.replace("length = 0.06", "length = { uniform = [0.055, 0.06] }"))
    planned = run_json(capsys, "generate", family, "--dry-run", "--count", "3")
    assert planned["count"] == 3 and planned["nodes"]["mean"] > 63 and not data.exists()
    made = run_json(capsys, "generate", family, "--out", data, "--count", "3", "--workers", "1", "--time-limit", "100")
    assert made["trajectories"] == 3 and made["failed_attempts"] == 0
    stats = run_json(capsys, "dataset", "stats", data, "--refined", "1")
    assert stats["count"] == 3 and stats["nodes"] == planned["nodes"] and stats["refined"]["count"] == 1
    assert run_json(capsys, "dataset", "card", data, "--refined", "0")["out"] == str(data / "README.md")
    report = run_json(capsys, "dataset", "pack", data, "--tolerance", "1e-6", "--out", packed)
    assert report["largest_error"] <= 1e-6 and report["ratio"] > 1
    assert run_json(capsys, "dataset", "unpack", packed, "--out", tmp_path / "again")["trajectories"] == 3
    assert run_json(capsys, "dataset", "check", tmp_path / "again", "--steps", "10") == {"problems": []}
    assert run_json(capsys, "dataset", "export", data, "--out", tmp_path / "records")["trajectories"] == 3
    assert run_json(capsys, "dataset", "import", tmp_path / "records", "--out", tmp_path / "back")["trajectories"] == 3
    assert run_json(capsys, "dataset", "check", tmp_path / "back") == {"problems": []}


@pytest.mark.parametrize("arguments, words", [
    ([], "VERB"),
    (["simulat"], "invalid choice"),
    (["simulate", "{scene}"], "--out"),
    (["simulate", "{scene}", "--out", "t.vtu"], "must end in .vtkhdf"),
    (["simulate", "{scene}", "--out", "/proc/t.vtkhdf"], "/proc/t.vtkhdf"),
    (["generate", "demo", "--out", "x", "--seed", "-1"], "not a whole number from 0"),
    (["dataset", "stats", "x", "--seed", "-1"], "not a whole number from 0"),
    (["dataset", "card", "x", "--refined", "-30"], "not a whole number"),
    (["generate", "demo", "--out", "x", "--count", "1000000000000"], "must be at most 1000000"),
    (["modes", "{scene}", "--count", "0"], "not a whole number above 0"),
    (["modes", "none.toml"], "No such file"),
    (["generate", "demoo", "--out", "x"], "did you mean 'demo'?"),
    (["generate", "beam"], "--out"),
    (["generate", "beam", "--out", "x", "--time-limit", "-1"], "time limit -1 s"),
    (["dataset", "stats", "none"], "manifest.json"),
    (["dataset", "card", "none"], "manifest.json"),
    (["dataset", "pack", "none", "--out", "x.pack"], "manifest.json"),
    (["dataset", "pack", "none", "--out", "x.zip"], "must end in .pack"),
    (["dataset", "unpack", "none.pack", "--out", "x"], "no such file"),
    (["dataset", "import", "none", "--out", "x"], "meta.json"),
    (["dataset", "export", "none", "--out", "x"], "manifest.json"),
    (["rollout", "none", "none.vtkhdf", "--out", "p.vtkhdf"], "none"),
    (["train", "none.toml", "--data", "none", "--out", "run"], "none.toml"),
    (["evaluate", "none", "--data", "none"], "none"),
    (["evaluate", "none", "--data", "none", "--out", "a/b"], "none"),
    (["pareto", "none"], "no trajectory files"),
    (["pareto", "{scene}", "--run", "none"], "no such checkpoint"),
    (["pareto", "none.toml", "--out", "a/b"], "none.toml"),
    (["verify", "none.vtkhdf", "--reference", "none.vtkhdf", "--out", "a/b"], "no such file"),
    (["view", "none.vtkhdf"], "no such file"),
    (["segment", "none.vtkhdf"], "no such file"),
])
def test_bad_input_ends_in_one_line_and_status_2(capsys, scene, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    try:
        status = fidelity.main([argument.format(scene=scene) for argument in arguments])
    except SystemExit as stop:
        status = stop.code
    out, err = capsys.readouterr()
    assert status == 2 and out == ""
    assert err.count("\n") == 1 and words in err
    assert {path.name for path in tmp_path.iterdir()} == {"scene.toml"}  # nothing is left behind


def test_a_stop_that_a_library_makes_an_error_of_its_loading_is_a_stop(scene, tmp_path, monkeypatch, capsys):
    def loading(*given, **rest):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as stop:
            raise ImportError("initialization failed") from stop

    monkeypatch.setattr(fidelity, "_parser", lambda: argparse_of(loading))
    assert fidelity.main([]) == 130 and capsys.readouterr().err == "fidelity: stopped; finished files are kept\n"


def argparse_of(function):
    return SimpleNamespace(parse_args=lambda arguments: SimpleNamespace(verb="simulate", verb_function=function, json=False))


@pytest.mark.parametrize("seconds", [0.3, 0.6])
def test_a_stop_while_libraries_are_loaded_leaves_no_traceback(scene, tmp_path, seconds):
    """They take some two seconds. Wherever the stop comes, the signal itself or our own word ends the program."""
    started = subprocess.Popen([sys.executable, ROOT / "fidelity.py", "simulate", scene, "--out", tmp_path / "a.vtkhdf"], text=True,
                               stderr=subprocess.PIPE, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    time.sleep(seconds)
    started.send_signal(signal.SIGINT)
    said = started.communicate(timeout=60)[1]
    assert (started.returncode, said) in ((-signal.SIGINT, ""), (130, "fidelity: stopped; finished files are kept\n"))

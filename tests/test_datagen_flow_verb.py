"""What `simulate` says of a flow and leaves behind, with the solver standing in."""

import argparse
import json
from types import SimpleNamespace

import numpy as np
import pytest

from datagen.flow import verb
from datagen.flow.verb import simulate_flow
from physics.schema import InputError, WorkError
from tests.flows import channel_flow

SCENE = channel_flow(steps={"count": 2, "duration": 0.02})


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Calls the verb with a solution of which parts may be changed; gives what it returns, what it says, and what it writes."""
    def called(processes=1, coefficients=True, csv=None, html=None, fields=None, **changes):
        said, written = [], []
        lift = np.array([0.0, 3.0, 2.0])
        solution = SimpleNamespace(**{
            "velocity": np.zeros((3, 1, 3)), "resumed": 0, "failure": "", "seconds": 1.5, "factorisations": 4, "remarks": ("look here",),
            "model": {"time": "none"}, "mesh": SimpleNamespace(points=np.zeros((7, 3))),
            "per_frame": {"iterations": np.array([0.0, 5.0, 6.0]), "pressure_difference": np.array([0.0, 1.0, 0.25])},
            "coefficients": lambda name: (lift * (10 if name == "drag" else 1)) if coefficients else None} | changes)

        def solved(scene, *, on_step, journal, partial):
            journal.write_text("unfinished")
            on_step(1)
            written.append((scene, journal.name, partial))
            return solution

        monkeypatch.setattr(verb, "solve_flow", solved)
        monkeypatch.setattr(verb, "flow_trajectory", lambda scene, found: (scene, found))
        monkeypatch.setattr(verb, "write_trajectory", lambda path, made: written.append((path.name, made[1] is solution)))
        monkeypatch.setattr(verb, "write_table", lambda path, made: written.append(path.name))
        options = argparse.Namespace(scene="s.toml", fields=fields, html=html, out=tmp_path / "o.vtkhdf", csv=csv)
        found = simulate_flow(SCENE, options, say=said.append, writable=lambda path, end, option="--out": path, processes=processes)
        return found, said, written
    return called


def test_a_flow_is_written_and_its_figures_are_told(run, tmp_path):
    found, said, written = run(csv=tmp_path / "t.csv")
    assert written == [(SCENE, "o.vtkhdf.part", True), ("o.vtkhdf", True), "t.csv"] and not (tmp_path / "o.vtkhdf.part").exists()
    assert found == {
        "frames": 2, "ms_per_frame": 750.0, "steps": 11, "factorisations": 4, "seconds": 1.5, "resumed_after_frame": 0, "nodes": 7,
        "per_frame": {"iterations": [0.0, 5.0, 6.0], "pressure_difference": [0.0, 1.0, 0.25]}, "model": {"time": "none"},
        "remarks": ["look here"], "drag_coefficient": 20.0, "lift_coefficient": 2.0, "largest_drag_coefficient": 30.0,
        "largest_lift_coefficient": 3.0, "pressure_difference": 0.25}
    json.dumps(found)
    assert said == [f"2 frames in 1.50 s, 11 steps: {tmp_path / 'o.vtkhdf'}", "  drag_coefficient: 20", "  lift_coefficient: 2",
                    "  pressure_difference: 0.25", "  time: none", "look here"]


def test_of_one_frame_gone_on_with_without_a_force(run, tmp_path):
    found, said, written = run(coefficients=False, velocity=np.zeros((2, 1, 3)), resumed=1, per_frame={"iterations": np.array([0.0, 5.0])},
                               remarks=())
    assert "drag_coefficient" not in found and "pressure_difference" not in found and len(written) == 2
    assert said == ["went on after frame 1, which an earlier run had reached", f"1 frame in 1.50 s, 5 steps: {tmp_path / 'o.vtkhdf'}",
                    "  time: none"]


def test_a_flow_that_came_to_no_end_keeps_its_frames_and_its_journal(run, tmp_path):
    with pytest.raises(WorkError, match=r"^frame 3: too fast; the 2 frames before it are in .*o\.vtkhdf; .* without o\.vtkhdf\.part from"):
        run(failure="frame 3: too fast")
    assert (tmp_path / "o.vtkhdf.part").read_text() == "unfinished"


@pytest.mark.parametrize("options, said", [(dict(processes=2), r"^s\.toml: a flow runs as one process"),
                                           (dict(fields=["stress"]), "^--fields: is for solids"),
                                           (dict(html="a.html"), "^--html: is for solids")])
def test_what_is_for_solids_is_refused(run, options, said, tmp_path):
    with pytest.raises(InputError, match=said):
        run(**options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("there, fine", [(None, True), (SCENE.to_toml(), True), ("another", False)])
def test_an_unfinished_run_of_another_scene_is_not_written_over(run, tmp_path, monkeypatch, there, fine):
    (tmp_path / "o.vtkhdf").touch()
    monkeypatch.setattr(verb, "unfinished", lambda path: there)
    if fine:
        run()
    else:
        with pytest.raises(InputError, match="an unfinished run of another scene"):
            run()

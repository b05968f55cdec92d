"""What a report is made of: which frames are drawn, which scenes are solved finer, the facts and the sentences, on known numbers."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from learning.prediction.predictor import Case, Predictor
from learning.report import evaluate as module
from learning.report.differences import spread_said
from learning.report.measure import Measurement, WorstFrame
from learning.samples.seen import SeenRange
from physics.mesh.build import build_mesh
from physics.schema import InputError
from tests.rows import row, rows
from tests.scenes import beam, pressed
from tests.synthetic import bending


def case(name: str, *, steps: int = 10, cells=(10, 2, 2), scene=None, seed: int = 0) -> Case:
    trajectory = bending(cells=cells, steps=steps, travel=0.02 + 1e-3 * seed)
    scene = scene or pressed(body={"length": 0.1, "width": 0.02, "height": 0.02, "cells": list(cells)})
    return Case(name, trajectory, scene, build_mesh(scene.body))


def made(kind: str = "fe", name: str = "a") -> Predictor:
    return Predictor(name, kind, lambda each: None)


# pictures

def test_the_worst_frames_of_the_five_worst_trajectories_of_the_best_network_are_drawn(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(module, "frame_picture", lambda path, mesh, **how: drawn.append((path, mesh, how)))
    cases = [case(f"000{i}", steps=9 + i, seed=i) for i in range(7)]
    errors = [3e-4, 7e-4, 1e-4, 5e-4, 6e-4, 2e-4, 4e-4]  # the worst first: 1, 4, 3, 6, 0
    frames = [
        WorstFrame(each, name, 2 + i, np.full((99, 3), i + shift), error + shift)
        for i, (each, error) in enumerate(zip(cases, errors, strict=True))
        for name, shift in (("M4GN a", 9.0), ("M4GN b", 0.0))
    ]
    pictures = module._pictures(tmp_path, Measurement(rows=rows(), frames=frames))
    assert [name for name, _ in pictures] == [f"frame_000{i}.png" for i in (1, 4, 3, 6, 0)]
    assert pictures[0][1].startswith(
        "Test trajectory 0001, RMSD-all 0.7 mm, at step 3 of 10, where the rollout is farthest from the truth."
    )
    assert len(drawn) == 5
    for i, (path, mesh, how) in zip((1, 4, 3, 6, 0), drawn, strict=True):
        assert path == tmp_path / f"frame_000{i}.png" and mesh is cases[i].mesh and (how["step"], how["steps"]) == (2 + i, 9 + i)
        assert (how["prediction"] == i).all() and np.array_equal(how["truth"], cases[i].truth[2 + i])
        assert how["names"] == ("M4GN b", "finite elements")
        assert np.array_equal(how["obstacle"].points, cases[i].trajectory.obstacle[0][2 + i])


def test_without_a_network_or_an_obstacle_no_picture_of_either(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(module, "frame_picture", lambda path, mesh, **how: drawn.append(how))
    bare = case("0")
    body = bare.trajectory.body
    monkeypatch.setattr(type(bare.trajectory), "obstacle", property(lambda self: None))
    frame = WorstFrame(bare, "M4GN a", 1, np.zeros((body.sum(), 3)), 1e-3)
    assert module._pictures(tmp_path, Measurement(rows=rows()[2:], frames=[frame])) == [] == drawn
    assert len(module._pictures(tmp_path, Measurement(rows=rows()[:1], frames=[frame]))) == 1 and drawn[0]["obstacle"] is None


# what is measured

@pytest.fixture
def measured(monkeypatch):
    """report_on with a measurement that asks nobody; what it was asked for, and a bar that counts."""
    asked = SimpleNamespace(bars=[], warm=[], said=[])
    monkeypatch.setattr(module, "paid_back", lambda rows, runs: rows)

    class Bar:
        def __init__(self, **how):
            asked.bars.append(how)
            self.count = 0

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def update(self):
            self.count += 1

    def measure(predictors, cases, **how):
        asked.measure = how
        return Measurement(rows=rows(), notes=["what went wrong"])

    monkeypatch.setattr(module, "tqdm", Bar)
    monkeypatch.setattr(module, "measure", measure)
    monkeypatch.setattr(module, "warm_up", asked.warm.append)
    monkeypatch.setattr(module, "_apart", lambda runs: {})
    monkeypatch.setattr(module, "_pictures", lambda out, found: [])
    monkeypatch.setattr(module, "write_report", lambda out, report, shown: asked.__dict__.update(report=report, out=out)
                        or {"summary": "words"})
    return asked


@pytest.mark.parametrize("refined, numbers", [(0, []), (1, [0]), (2, [0, 4]), (3, [0, 2, 4]), (4, [0, 1, 3, 4]), (9, [0, 1, 2, 3, 4])])
def test_scenes_solved_finer_are_evenly_spaced_and_as_many_as_asked_for(measured, tmp_path, refined, numbers):
    cases = [case(str(i)) for i in range(5)]
    result = module.report_on([made(), made(name="b")], cases, tmp_path / "out", title="T", runs={}, refined=refined, repeats=7)
    assert measured.measure["refined"] == numbers
    assert (measured.measure["sample"], measured.measure["repeats"]) == (25, 7)
    assert measured.bars == [{"total": 10, "desc": "evaluate", "disable": None, "unit": "rollout"}] and measured.warm == [cases[0]]
    assert result == {"summary": "words", "report": str(tmp_path / "out")} and (tmp_path / "out").is_dir()
    assert measured.out == tmp_path / "out"
    with pytest.raises(InputError, match="two predictors are called 'b'"):
        module.report_on([made(), made(name="b"), made(name="b")], cases, tmp_path, title="T", runs={}, refined=0)


def test_a_report_gathers_title_names_rows_and_notes(measured, tmp_path):
    module.report_on([made()], [case("0003"), case("0007")], tmp_path / "out", title="T", runs={}, refined=0, say=measured.said.append)
    report = measured.report
    assert (report.title, report.cases, report.rows, report.pictures, report.outside) == ("T", ["0003", "0007"], rows(), [], None)
    assert measured.measure["repeats"] == 1
    assert report.notes[-1] == "what went wrong" and report.facts["test trajectories"].startswith("2: 0003, 0007; ")
    last = f"report: {tmp_path / 'out' / 'report.html'}"
    assert measured.said == [*module.summary(rows()), "words", *spread_said(rows()), "what went wrong", last]


def test_how_far_outside_is_told_by_the_first_run_that_knows_its_ranges(measured, tmp_path, monkeypatch):
    model = SimpleNamespace(title="M4GN")
    known = {"a": None, "b": SeenRange({"steps": (5.0, 8.0)}, {}, 3), "c": SeenRange({"steps": (1.0, 20.0)}, {}, 3)}
    monkeypatch.setattr(module, "read_seen", known.get)
    monkeypatch.setattr(module, "_facts", lambda *given: {})
    module.report_on([made()], [case("in", steps=6), case("out", steps=11)], tmp_path, title="T",
                     runs=dict.fromkeys(known, model), refined=0)
    assert measured.report.outside == {"in": {}, "out": {"steps": 1.0}}  # 3 steps beyond a range of 3
    module.report_on([made()], [case("out", steps=11)], tmp_path, title="T", runs={"a": model}, refined=0)
    assert measured.report.outside is None


def test_the_summary_is_in_mm_with_a_dash_for_what_is_missing():
    some = [row("M4GN", "learned", 12.3456, 4e-4, rmsd_1=2.5e-6, rmsd_50=3e-5, rmsd_refined=6.5e-3), row("FE", "fe", 0.5, 1.0)]
    assert module.summary(some) == [
        " " * 37 + "  ms/step    RMSD-1   RMSD-50  RMSD-all  to finer  [mm, free nodes]",
        "M4GN" + " " * 33 + "     12.3    0.0025      0.03       0.4       6.5",
        "FE" + " " * 35 + "      0.5         –         –      1000         –"]


def test_what_is_solved_to_warm_up_is_the_coarsest_scene(monkeypatch):
    solved = []
    monkeypatch.setattr(module, "follow", lambda scene, mesh: solved.append(scene))
    module.warm_up(SimpleNamespace(scene=pressed(), mesh=None))
    assert [scene.body.divisions for scene in solved] == [(2, 2, 2)]


# facts

STATE = SimpleNamespace(about={"step": 4000, "seconds": 61.7, "best_step": 3500})


def facts(monkeypatch, cases, *, repeats: int = 1, runs=None, solved_again: float = 0.0) -> dict[str, str]:
    monkeypatch.setattr(module, "read_stored", lambda path: (STATE.about, {}) if path == Path("runs/m4gn/model.safetensors") else None)
    return module._facts(runs or {}, cases, Measurement(solved_again=solved_again), repeats)


def test_the_facts_tell_what_was_tested_and_trained(monkeypatch):
    network = torch.nn.Linear(4, 3)  # 12 + 3 weights
    model = SimpleNamespace(network=network, config=SimpleNamespace(seed=17), title="M4GN")
    scene = pressed(material={"young_modulus": 1e6, "poisson_ratio": 0.4, "law": "linear"},
                    body={"length": 0.1, "width": 0.02, "height": 0.02, "cells": [4, 3, 2], "cell": "hexahedron"})
    cases = [case("b", steps=12), case("a", steps=6, cells=(4, 3, 2), scene=scene)]
    told = facts(monkeypatch, cases, runs={"runs/m4gn": model}, solved_again=2.5e-9)
    assert told["test trajectories"] == (
        "2: b, a; 60 to 99 nodes, 6 to 12 steps; free nodes are those that neither a support holds nor the obstacle is made of"
    )  # 5 x 4 x 3 and 11 x 3 x 3
    assert told["network m4gn"] == (
        "M4GN from runs/m4gn: 15 weights, trained 4000 steps in 62 s, of which step 3500 did best in validation and is shown; seed 17"
    )
    assert told["truth"] == (
        "first-order hexahedra, prisms, linear, neo-hookean; solved again here, it differs from the files by 2.5e-06 mm "
        "at most (they hold 32-bit numbers)"
    )
    assert told["timing"].endswith("on each scene; each prediction timed once")
    assert told["equations and mesh"] == "checked at up to 25 frames of each trajectory; errors and penetration at all frames"
    assert "PyTorch" in told["threads"] and "torch " + torch.__version__ in told["versions"] and len(told["date"]) == 10


def test_the_facts_of_one_size_have_no_range_and_repeats_are_told(monkeypatch):
    told = facts(monkeypatch, [case("b")], repeats=3)
    assert told["test trajectories"].startswith("1: b; 99 nodes, 10 steps;")
    assert told["timing"].endswith("; medians of 3 predictions, one for those of more than 1 s")
    assert list(told) == [
        "test trajectories",
        "gathering",
        "timing",
        "truth",
        "equations and mesh",
        "machine",
        "threads",
        "versions",
        "program",
        "date",
    ]


def test_words_of_lists_are_cut_after_four():
    assert module._words(["b", "a", "b"]) == "a, b" and module._words("dcba") == "a, b, c, d"
    assert module._words("edcba") == "a, b, c, d and 1 more" and module._words("gfedcba") == "a, b, c, d and 3 more"
    assert module._range([3]) == "3" and module._range([3, 3, 7]) == "3 to 7"


# sentences

def limits(found: Measurement, *, cases=None, runs=None, spans=()):
    return module._limits(cases or [case("0"), case("1"), case("2")], found, runs or {}, spans)


def finer(each: tuple[float, ...]):
    """The rows with errors to finer cells: the reference 0.3 mm, M4GN a 0.45 and corrected 0.36."""
    some = rows()
    for i, error, below in ((0, 4.5e-4, 0.125), (1, 5e-4, 0.25), (2, 3.6e-4, 0.75), (5, 3e-4, 1.0)):
        some[i] = replace(some[i], scores=some[i].scores | {"rmsd_refined": error, "below_data": below},
                          each=tuple({"rmsd_refined": value} for value in each))
    return some


def test_the_first_limit_tells_the_error_of_the_data_and_what_networks_have_beside_it():
    first = limits(Measurement(rows=finer((3e-4, math.nan, 3e-4))))[0]
    assert first.endswith(
        "On 2 of the 3 scenes, solved again on cells of half the size, the data are 0.3 mm off (and the finer solution "
        "by about a third of that, if "
        "errors fall with the square of the cells' size). M4GN a: 0.45 mm from the finer solution; in 12 % of the "
        "frames closer to the data than "
        "these to it. M4GN b: 0.5 mm from the finer solution; in 25 % of the frames closer to the data than these to "
        "it. M4GN b, corrected 10-fold: "
        "0.36 mm from the finer solution; in 75 % of the frames closer to the data than these to it."
    )
    for some in (rows(), rows()[:5]):
        assert limits(Measurement(rows=some))[0].endswith("not that the body is known better.")


def test_materials_and_cells_are_told():
    stiff = beam(material={"young_modulus": 2.5e6, "poisson_ratio": 0.25, "law": "linear"},
                 body={"length": 0.1, "width": 0.02, "height": 0.02, "cells": [2, 2, 2], "cell": "hexahedron"})
    assert limits(Measurement(), cases=[case("0"), case("1", cells=(2, 2, 2), scene=stiff)])[1] == (
        "Materials: linear (E = 2.5e+06 Pa, nu = 0.25), neo-hookean (E = 1e+06 Pa, nu = 0.4). Cells: hexahedron, "
        "prism. Of other materials and "
        "kinds of mesh nothing is said here."
    )


def test_what_is_known_of_the_training_is_the_last_limit_before_what_went_wrong():
    found = Measurement(notes=["wrong 1", "wrong 2"])
    without, some = limits(found), limits(found, runs={"a": None}, spans=[SeenRange({}, {}, 1)])
    assert len(without) == 6 + 2 and without[-2:] == ["wrong 1", "wrong 2"] == some[-2:]
    assert some[-3].startswith("The test scenes lie inside or outside of the ranges listed above.") and len(some) == 9
    assert limits(found, runs={"a": None})[-3].startswith("The run does not say what it was trained on (no range.json)")


def test_what_newton_steps_make_of_a_network_is_told_by_factor_and_time():
    some = [
        *rows(),
        row("M4GN b, as the start of Newton", "hybrid", 40.0, 1e-9, iterations=2.75),
        row("other, corrected 10-fold", "hybrid", 1.0, 1.0),
        row("M4GN b, of a stranger", "foreign", 2.0, 1.0),
    ]
    # 0.2 mm / 0.05 mm is 4, 9 ms - 8 ms is 1
    assert module._of_correction(some) == [
        "M4GN b, corrected 10-fold: the error over whole rollouts falls by a factor of 4, for 1 ms a step more; "
        "the solver itself takes 32 ms.",
        "M4GN b, as the start of Newton: 2.75 Newton steps for each step of the loading and 40 ms; from the polynomial "
        "through the last states, "
        "as the solver starts by itself, 4.25 and 32 ms.",
    ]
    assert module._of_correction(some[:5]) == []  # no reference
    assert [words for words in limits(Measurement(rows=some)) if "a factor of 4" in words] == module._of_correction(some)[:1]


def test_where_a_predictor_does_not_know_is_told_by_the_share_of_its_frames_and_how_far_off_it_is_elsewhere():
    """Of three trajectories with errors 0.2, 0.3 and 0.7 mm it is unsure in none, a quarter and all of the frames."""
    cases, nan = [case("0"), case("1"), case("2")], math.nan

    def told(*shares):
        one = rows()[0]
        one = replace(one, each=tuple(each | {"unsure": share} for each, share in zip(one.each, shares, strict=True)))
        return module._of_doubt([one, rows()[1]], cases)

    assert told(0.0, 0.25, 1.0) == ["M4GN a says that it does not know: 1 (25 % of the frames), 2 (100 % of the frames). In the other 1 "
                                    "trajectories it is 0.2 mm off at most."]
    assert told(0.0, 0.0, 0.0) == ["M4GN a says that it does not know: none of them. In the other 3 trajectories it is 0.7 mm off at most."]
    assert told(0.5, 0.25, 1.0) == ["M4GN a says that it does not know: 0 (50 % of the frames), 1 (25 % of the frames), 2 (100 % of the "
                                    "frames)."]
    assert told(nan, 0.25, nan) == ["M4GN a says that it does not know: 1 (25 % of the frames). In the other 2 trajectories it is 0.7 mm "
                                    "off at most."]
    assert told(nan, nan, nan) == []


def test_of_data_without_a_scene_no_equations_are_spoken_of():
    plain = Case("0", bending(steps=10), None, case("0").mesh)
    assert module._material(plain) == "not known" and module._material(case("0")).startswith("neo-hookean (E = 1e+06 Pa")
    told = module._facts({}, [plain], Measurement(), 1)["truth"]
    assert told.startswith("the files: they hold no scene") and module._facts({}, [case("0")], Measurement(), 1)["truth"].startswith(
        "first-order prisms, neo-hookean; solved again here, it differs from the files by 0.0e+00 mm at most")


# the list of predictors

def test_evaluate_measures_the_network_and_its_rivals_in_order(monkeypatch, tmp_path):
    given = {}
    model = SimpleNamespace(config=SimpleNamespace(estimate=False), title="M4GN")
    monkeypatch.setattr(module, "load_model", lambda run, device: model)
    one = SimpleNamespace(known="scene")
    monkeypatch.setattr(module, "load_cases", lambda files: [one for _ in files])
    monkeypatch.setattr(
        module, "report_on", lambda predictors, cases, out, **how: given.update(how, p=predictors, cases=cases, out=out) or {"a": 1}
    )
    assert module.evaluate("run", ["f"], str(tmp_path), correct=2, refined=4) == {"a": 1}
    names = ["M4GN", "M4GN, corrected 100-fold", "nothing moves", "keep the last velocity", "quadratic extrapolation",
             "FE, cells twice as large",
             "FE, cells four times as large", "FE, the reference"]
    assert [(each.name, each.kind) for each in given["p"]] == list(
        zip(names, ("learned", "hybrid", *["trivial"] * 3, "fe", "fe", "reference"), strict=True)
    )
    assert (given["cases"], given["out"], given["runs"], given["refined"]) == ([one], tmp_path, {"run": model}, 4)
    one.known = None
    assert module.evaluate("run", ["f"], tmp_path, refined=4) == {"a": 1}
    assert [each.name for each in given["p"]] == ["M4GN", *names[2:5]] and given["refined"] == 0 and given["title"].endswith("its data")
    one.known = "scene"
    model.config.estimate = True
    module.evaluate("run", ["f"], tmp_path)
    assert [each.name for each in given["p"]] == ["M4GN", "M4GN, its estimate alone", "M4GN, corrected 10-fold", *names[2:]]
    assert given["refined"] == 1
    models = {"run": model, "x/fast": SimpleNamespace(config=model.config, title="sections"), "x/b": model}
    monkeypatch.setattr(module, "load_model", lambda run, device: models[run])
    module.evaluate("run", ["f"], tmp_path, beside=["x/fast"])
    assert [each.name for each in given["p"]][:4] == ["M4GN", "M4GN, its estimate alone", "M4GN, corrected 10-fold", "sections"]
    assert [each.name for each in given["p"]][4:] == names[2:] and given["runs"] == {"run": model, "x/fast": models["x/fast"]}
    module.evaluate("run", ["f"], tmp_path, beside=["x/b"])
    assert [each.name for each in given["p"]][:4] == ["M4GN run", "M4GN run, its estimate alone", "M4GN run, corrected 10-fold", "M4GN b"]


def test_halved_cells_are_halved_as_often_as_they_say(monkeypatch):
    halvings = {}
    monkeypatch.setattr(module, "load_model", lambda run, device: SimpleNamespace(
        config=SimpleNamespace(estimate=False), title="M4GN"))
    monkeypatch.setattr(module, "load_cases", lambda files: [SimpleNamespace(known="scene")])
    monkeypatch.setattr(module, "report_on", lambda *given, **how: {})
    monkeypatch.setattr(module, "elements", lambda name, **how: halvings.update({name: how}))
    module.evaluate("run", ["f"], "out")
    assert halvings == {"FE, cells twice as large": {"halvings": 1},
                        "FE, cells four times as large": {"halvings": 2}, "FE, the reference": {}}


def test_cases_are_named_by_their_files(monkeypatch):
    one = case("x")
    monkeypatch.setattr(module, "read_reference", lambda file: (one.trajectory, one.scene, file))
    cases = module.load_cases(["a/0003.vtkhdf", Path("b/0007.vtkhdf")])
    assert [(each.name, each.mesh, each.scene is one.scene) for each in cases] == [
        ("0003", "a/0003.vtkhdf", True), ("0007", Path("b/0007.vtkhdf"), True)]

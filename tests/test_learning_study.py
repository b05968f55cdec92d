"""Studies: what a file asks for, trainings that are stopped and gone on with, and what a table says of them."""

import csv
import json
import math
import re
from dataclasses import replace

import pytest
import torch

import fidelity
from learning.config import Outputs, TrainConfig
from learning.networks.m4gn import M4GNConfig
from learning.networks.rivals.bsms import BSMSConfig
from learning.networks.rivals.gcn import GCNConfig
from learning.networks.rivals.mgn import MGNConfig
from learning.study import work
from learning.study.plan import FOLDER, SIZES, Trial, load_plan
from learning.study.run import read_study, run_study
from learning.study.table import Score, check_published, gathered, markdown
from learning.study.work import Training, carried_out, step_memory, step_ms, still
from learning.training import train as loop
from physics.schema import InputError, finite
from tests.five_nodes import square_flow, write_set
from tests.synthetic import bending

TINY = """
title = "Two networks"
source = "nobody"
[base]
contact_radius = 0.006
noise = 1e-3
[[row]]
name = "plain"
set = { network = { kind = "gcn" } }
published = { rmse_all = [2e-3, 5e-4], mc = 0.25 }
[[row]]
name = "in segments"
set = { segments = 3, noise = 1e-4, network = { kind = "m4gn", message_steps = 1 } }
[[test]]
name = "as trained on"
[[test]]
name = "four / segments"
set = { segments = 4 }
[check]
seeds = 2
data = { family = "demo", train = 2, valid = 1, test = 1 }
set = { steps = 4, batch_size = 2, validate_every = 2, segments = 5 }
networks = { all = { hidden = 4 }, gcn = { layers = 2 }, m4gn = { message_steps = 3, transformer_layers = 1, heads = 2 } }
"""


def written(folder, text):
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    scenes = {"train/0000": dict(cells=(5, 2, 2), steps=4), "train/0001": dict(cells=(4, 2, 2), steps=4, at=0.06),
              "valid/0000": dict(cells=(4, 2, 2), steps=3), "test/0000": dict(cells=(4, 2, 2), steps=4, at=0.08)}
    write_set(folder, {f"{name}.vtkhdf": bending(**scene) for name, scene in scenes.items()})
    return folder


# ---- what a file asks for


def test_a_trainings_config_is_made_of_base_size_row_and_grid(tmp_path):
    plan = load_plan(written(tmp_path, TINY + '[grid]\nbatch_size = [1, 3]\n"network.hidden" = [6, 8]\n'), "check")
    assert [row.name for row in plan.rows] == [f"{name}, batch_size {batch}, hidden {hidden}" for name in ("plain", "in segments")
                                               for batch in (1, 3) for hidden in (6, 8)]
    common = TrainConfig(contact_radius=0.006, steps=4, validate_every=2)
    assert plan.rows[1].config == replace(common, noise=1e-3, segments=5, batch_size=1, network=GCNConfig(hidden=8, layers=2))
    network = M4GNConfig(hidden=6, message_steps=1, transformer_layers=1, heads=2)
    assert plan.rows[6].config == replace(common, noise=1e-4, segments=3, batch_size=3, network=network)
    mc = pytest.approx((0.25, math.nan), nan_ok=True)
    assert plan.seeds == 2 and plan.rows[0].published == {"as trained on": {"rmse_all": (2e-3, 5e-4), "mc": mc}}
    assert plan.tests == (Trial("as trained on", "data"), Trial("four / segments", "data", {"segments": 4}))


def test_a_study_like_another_has_its_sizes_and_may_change_them(tmp_path):
    written(tmp_path, TINY)
    (tmp_path / "other.toml").write_text('like = "study"\n[check]\nseeds = 1\ndata = { test = 3, set = { steps = { count = 7 } } }\n'
                                         '[[test]]\nname = "large"\nfamily = "beam-small"\n[[row]]\nname = "one"\n'
                                         'published = { mc = 1, large = { mc = 2 } }\n')
    plan = load_plan(tmp_path / "other.toml", "check")
    assert [row.name for row in plan.rows] == ["one"] and plan.seeds == 1 and plan.rows[0].config.contact_radius == 0.006
    family, made = plan.sets["data"]
    assert (made.train, made.test, family["steps"]["count"], family["name"]) == (2, 3, 7, "demo")
    family, made = plan.sets["beam-small"]
    assert (made.train, made.test, family["steps"]["count"], family["name"]) == (0, 3, 7, "beam-small")
    assert plan.tests == (Trial("large", "beam-small"),) and list(plan.rows[0].published) == ["large"]


@pytest.mark.parametrize("change, said", [
    (("noise = 1e-3", "noises = 1e-3"), r"row\[0\] \(plain\): noises: unknown key; did you mean 'noise'"),
    (('kind = "gcn"', 'kind = "gcnn"'), r"row\[0\] \(plain\): network.kind = 'gcnn': must be one of .*did you mean 'gcn'"),
    (("[[test]]", "[[tests]]"), "tests: unknown key; did you mean 'test'"),
    (("seeds = 2", "seeds = 0"), "check.seeds = 0: must be a whole"),
    (('family = "demo"', 'family = "dem"'), "check.data.family = 'dem': must be one of .*did you mean 'demo'"),
    (("train = 2", "train = -2"), "check.data.train = -2: must be at least 0"),
    (("train = 2", "train = 0"), "check.data.train: must be at least 1"),
    (('family = "demo"', 'set = { steps = { count = 0 } }, family = "demo"'), "check.data.set: steps.count = 0: must be at least 1"),
    (('name = "plain"', 'name = "in segments"'), "a name of its own"),
    (("mc = 0.25", 'mc = "low"'), r"row\[0\].published.mc = 'low': must be a number"),
    (("[check]", "[small]"), "check: no such size .* it has small"),
    (("networks =", "network ="), "network: unknown key; did you mean 'networks'"),
    (('title = "Two', 'like = "it"\ntitle = "Two'), "no study 'it'")])
def test_what_is_wrong_in_a_study_is_said_in_one_line(tmp_path, change, said):
    assert change[0] in TINY
    with pytest.raises(InputError, match=said) as caught:
        load_plan(written(tmp_path, TINY.replace(*change)), "check")
    assert "\n" not in str(caught.value)


def test_a_study_like_itself_is_refused(tmp_path):
    with pytest.raises(InputError, match="a chain of studies that does not end"):
        load_plan(written(tmp_path, 'like = "study"\n'), "check")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.toml")), ids=lambda file: file.stem)
def test_every_study_of_the_package_has_every_size(file, size):
    plan = load_plan(file.stem, size)
    assert plan.seeds == (3 if size != "check" and file.stem != "cost" else 1)
    flows = "cylinder-flow-small" if size == "check" else "cylinder-flow"
    families = {"materials": "beam-materials", "plate": "plate", "flow": flows, "solid": "demo"}
    assert plan.sets["data"][1].family == families.get(file.stem, "beam-plane")
    assert len(plan.rows) == {"main": 7, "transfer": 3, "message-steps": 6, "method": 7, "segments": 10, "generalisation": 6, "noise": 28,
                              "bundle": 3, "cost": 7, "materials": 3, "plate": 7, "flow": 7, "solid": 1}[file.stem]


def test_the_paper_sizes_are_the_papers():
    # Lei et al., appendix "Training Details", "M4GN Configurations", "Baselines": DeformingBeam; sets of 355 / 40 / 60
    rows = {row.name: row for row in load_plan("main", "paper").rows}
    assert rows["M4GN"].config == TrainConfig(overlap=1) and rows["MGN"].config == TrainConfig(noise=1e-3, network=MGNConfig())
    assert rows["M4GN"].published["test"]["rmse_all"] == (1.87e-4, 0.12e-4) and rows["BSMS-GNN"].published["test"]["gf_c"] == (2.1e-7, 4e-8)
    assert load_plan("main", "paper").sets["data"][1].splits == {"train": 355, "valid": 40, "test": 60}
    small = load_plan("main", "small")  # 20 000 samples, 120 beams
    assert all(row.config.steps * row.config.batch_size == 20_000 for row in small.rows) and small.sets["data"][1].train == 120


def test_the_paper_sizes_of_flows_are_the_papers():
    # Lei et al., appendices "Training Details", "M4GN Configurations", "Baselines": CylinderFlow; its set has 1000 / 100 / 100
    plan = load_plan("flow", "paper")
    rows = {row.name: row for row in plan.rows}
    common = TrainConfig(modes="laplacian", mode_count=6, tau=1.0, noise=0.02, segments=36, steps=2_000_000, validate_every=20_000,
                         outputs=Outputs(fields=("pressure",)))
    assert rows["M4GN"].config == replace(common, overlap=1, network=M4GNConfig(walk=16))
    assert rows["BSMS-GNN"].config == replace(common, network=BSMSConfig(levels=7))
    published = rows["M4GN"].published["test"]
    assert published["velocity_rmse_50"] == (60.2e-4, 2.4e-4) and published["velocity_rmse_all"] == (337e-4, 21e-4)
    assert rows["BSMS-GNN"].published["test"]["velocity_rmse_1"] == (181e-5, 22e-5)
    assert {key: published[key][0] for key in ("train_ms", "test_ms", "memory", "hours")} == {
        "train_ms": 56.2, "test_ms": 20.0, "memory": 366.6e6, "hours": 31.2}
    assert plan.sets["data"][1].splits == {"train": 1000, "valid": 100, "test": 100}


def test_the_plates_of_the_paper_are_trained_as_there():
    # Lei et al., "Training Details", "M4GN Configurations", "Baselines": DeformingPlate, 2 M steps, 19 segments without overlap, tau 1
    rows = {row.name: row for row in load_plan("plate", "paper").rows}
    outputs = Outputs(fields=("von_mises",))
    m4gn = TrainConfig(steps=2_000_000, validate_every=20_000, tau=1.0, noise=0.003, contact_radius=0.01, outputs=outputs)
    assert rows["M4GN"].config == m4gn and rows["MGN"].config == replace(m4gn, network=MGNConfig(world_radius=0.03))
    assert [rows[name].config.network.levels for name in ("g-U-Net", "BSMS-GNN")] == [6, 6]
    assert rows["M4GN"].published["test"]["rmse_all"][0] == 2.65e-3 and rows["Transolver"].published["test"]["rmse_all"][0] == 3.02e-3
    assert load_plan("plate", "paper").sets["data"][1].splits == {"train": 1000, "valid": 100, "test": 100}


# ---- trainings


def jobs_in(folder, plan, data, seeds=1):
    tests = tuple((test, data) for test in plan.tests)
    return {(row.name, seed): Training(folder / row.name / str(seed), replace(row.config, seed=seed), data, tests)
            for row in plan.rows for seed in range(seeds)}


def found_in(job):
    """What a training has led to, times left out."""
    found = [json.loads(job.found(test).read_text()) for test, _ in job.tests]
    found.append(json.loads((job.folder / "trained.json").read_text()))
    return [{key: value for key, value in each.items() if not re.search("seconds|ms_per_step|step_ms|^run$", key)} for each in found]


def test_a_training_stopped_at_any_step_and_between_any_two_files_comes_to_the_same(tmp_path, data, monkeypatch):
    plan = load_plan(written(tmp_path, TINY), "check")
    whole, cut = (jobs_in(tmp_path / name, plan, data)["in segments", 0] for name in ("whole", "cut"))
    carried_out(whole)
    assert whole.done and not cut.done
    calls = {"left": 0}

    def counted(function):
        def stopping(*given, **named):
            calls["left"] -= 1
            if calls["left"] < 0:
                raise KeyboardInterrupt
            return function(*given, **named)
        return stopping

    for module, name in ((loop, "take_step"), (loop, "_validate"), (work, "write_json"), (work, "step_memory"), (work, "measure")):
        monkeypatch.setattr(module, name, counted(getattr(module, name)))
    for instant in range(8):
        calls["left"] = instant % 4
        with pytest.raises(KeyboardInterrupt):
            carried_out(cut)
        if (cut.folder / "on-four-segments.json").exists():
            break
    calls["left"] = 1000
    carried_out(cut)
    assert cut.done and found_in(cut) == found_in(whole)


def test_a_training_is_tested_as_a_test_has_it(tmp_path, data):
    plan = load_plan(written(tmp_path, TINY), "check")
    job = jobs_in(tmp_path, plan, data)["in segments", 0]
    carried_out(job)
    first, other, trained = found_in(job)
    assert first["rmse_all"] != other["rmse_all"] and first["gf_h"] > 0 and first["relative_residual"] is None
    assert trained["memory"] == step_memory(job) and trained["parameters"] == sum(
        weight.numel() for weight in torch.nn.ModuleList([work.load_model(job.folder / "run").network]).parameters())


def test_a_step_holds_four_numbers_a_weight_and_what_grows_with_the_batch(tmp_path, data):
    job = jobs_in(tmp_path, load_plan(written(tmp_path, TINY), "check"), data)["plain", 0]
    carried_out(job)
    four, eight = (step_memory(replace(job, config=replace(job.config, batch_size=size, noise=0.0))) for size in (4, 8))  # all, and twice
    fixed = 16 * found_in(job)[-1]["parameters"]  # weights, gradients and two moments of 4 bytes each
    assert 2 * four - eight == fixed < eight - four


def test_validation_is_no_part_of_a_steps_time():
    curve = [{"step": 50, "seconds": 5.0, "loss": 1}, {"step": 100, "seconds": 10.0, "loss": 1}, {"step": 100, "seconds": 10.0, "error": 1},
             {"step": 150, "seconds": 99.0, "loss": 1}, {"step": 200, "seconds": 104.0, "loss": 1}]
    assert step_ms(curve, {"seconds": 1.0, "steps": 1}) == pytest.approx(100)
    assert step_ms(curve[:1], {"seconds": 6.0, "steps": 30}) == pytest.approx(200)


# ---- the table


def told(tmp_path, errors, seconds=1.0):
    """The result of made-up trainings: errors [m] of each row's seeds, None where the rollout blew up."""
    plan = replace(load_plan(written(tmp_path, TINY), "check"), tests=(Trial("as trained on", "data"),), seeds=len(errors[0]))
    jobs = jobs_in(tmp_path, plan, tmp_path, plan.seeds)
    for number, (row, values) in enumerate(zip(plan.rows, errors, strict=True)):
        for seed, error in enumerate(values):
            job = replace(jobs[row.name, seed], tests=((plan.tests[0], tmp_path),))
            jobs[row.name, seed] = job
            (job.folder / "run").mkdir(parents=True)
            scores = {} if error is None else {"rmse_all": error, "mc": math.nan, "ms_per_step_alone": 3.0, "rmse_all:stress": 2e4}
            job.found(plan.tests[0]).write_text(json.dumps(finite(scores)))
            took = {"seconds": seconds * (number + 1), "parameters": 1234567, "step_ms": 5.0, "memory": 2e6}
            (job.folder / "trained.json").write_text(json.dumps(took))
            (job.folder / "run" / "curve.jsonl").write_text("".join(json.dumps(line) + "\n" for line in (
                {"step": 1, "seconds": 0.9, "error": 3e-3}, {"step": 2, "seconds": 1.5, "error": 1e-3 * (seed + 1)})))
    return gathered(plan, jobs, {"as trained on": {"rmse_all": 5e-3}})


def test_means_deviations_and_published_figures_stand_in_the_table(tmp_path):
    found = told(tmp_path, [[1e-3, 2e-3, 3e-3], [4e-3, 4e-3, 4e-3]])
    cells = found.cells["plain"]["as trained on"]
    assert cells["rmse_all"] == Score(pytest.approx(2e-3), pytest.approx(1e-3), 3, (2e-3, 5e-4))  # the sample's deviation of 1, 2, 3
    assert cells["valid_equal"].mean == pytest.approx(3e-3)  # the quickest is done at 1 s, before the second validation
    lines = markdown(found).splitlines()
    head = next(line for line in lines if "RMSE-all [mm]" in line).split("|")
    row = next(line for line in lines if line.startswith("| plain ")).split("|")
    assert row[head.index(" RMSE-all [mm] ")] == " 2 ± 1 [2 ± 0.5] " and row[head.index(" MC ")] == " – [0.25] "
    assert row[head.index(" parameters ")] == " 1234567 " and row[head.index(" RMSE-all of stress [Pa] ")] == " 2e+04 "
    assert next(line for line in lines if line.startswith("| nothing moves ")).split("|")[head.index(" RMSE-all [mm] ")] == " 5 "


@pytest.mark.parametrize("errors, said", [
    # s^2 = (1 + 0)/2 mm^2; two standard errors of three seeds each: 2 sqrt(2 * 0.5 / 3) = 1.15 mm
    ([[1e-3, 2e-3, 3e-3], [3.2e-3] * 3], "in segments has 1.2 mm more than plain: more than two standard errors of 3 seeds each."),
    ([[1e-3, 2e-3, 3e-3], [3.1e-3] * 3],
     "in segments has 1.1 mm more than plain, which 3 seeds each cannot tell from chance; some 4 would."),
    ([[2e-3], [3e-3]], "in segments has 1 mm more than plain; one seed does not say whether that is more than chance."),
    ([[2e-3, None], [3e-3, 3e-3]], "plain: 1 of 2 trainings led to rollouts that blow up")])
def test_the_spread_says_what_can_be_told_apart(tmp_path, errors, said):
    assert said in told(tmp_path, errors).apart("as trained on")


# ---- the whole


def test_a_study_is_carried_out_once_and_its_folder_is_its_own(tmp_path, data, capsys):
    study = written(tmp_path, TINY.replace("seeds = 2", "seeds = 1"))
    options = ["--size", "check", "--data", str(data), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert fidelity.main(["study", str(study), *options]) == 0
    said = capsys.readouterr().out
    assert "RMSE-all on as trained on [mm]:" in said and "nothing moves" in said
    table = (tmp_path / "out" / "table.md").read_text()
    with open(tmp_path / "out" / "table.csv") as file:
        lines = list(csv.DictReader(file))
    assert {line["row"] for line in lines} == {"plain", "in segments", "nothing moves"} and "## Tested on: four / segments" in table
    error = next(line for line in lines if (line["row"], line["test"], line["figure"]) == ("plain", "as trained on", "rmse_all"))
    assert float(error["mean"]) > 0 and float(error["published"]) == 2e-3 and error["deviation"] == "" and error["seeds"] == "1"
    page = (tmp_path / "out" / "report.html").read_text()
    assert "data:image/png;base64," in page and "<th scope=\"row\">in segments</th>" in page
    assert run_study(study, tmp_path / "out", size="check", data=data)["new"] == 0
    assert (tmp_path / "out" / "table.md").read_text() == table
    seen = read_study(study, tmp_path / "out", size="check", data=data)
    rows = seen.table("as trained on")
    assert len(rows) == 3 and all(" | ".join(row) in table for row in [seen.heads(), *rows])
    with pytest.raises(InputError, match=r"out: holds no study"):
        read_study(study, tmp_path / "nothing/out", size="check")
    with pytest.raises(InputError, match="holds a study with other rows; choose another folder"):
        run_study(written(tmp_path, study.read_text().replace("steps = 4", "steps = 5")), tmp_path / "out", size="check", data=data)
    with pytest.raises(InputError, match="holds something that is no study"):
        run_study(study, data, size="check")
    assert fidelity.main(["study", "mane", "--out", str(tmp_path / "no")]) == 2 and not (tmp_path / "no").exists()
    assert "no study 'mane': give a .toml file or one of" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"^row 'plain': published\.rmse_al: no such figure; did you mean 'rmse_all'\? there are gf_h, "):
        run_study(written(tmp_path, study.read_text().replace("rmse_all", "rmse_al")), tmp_path / "new", size="check", data=data)
    assert not (tmp_path / "new").exists()


def test_a_study_of_flows_tells_errors_of_the_velocity(tmp_path):
    """Nodes 2 and 4 have (t^2, n t) / 16 m/s: what does not change from frame 1 on is (t^2 - 1, n t - n) / 16 off in frames 2 to 8."""
    write_set(tmp_path / "data", {f"{split}/0000.vtkhdf": square_flow() for split in ("train", "valid", "test")})
    plan = load_plan(written(tmp_path, """
[[row]]
name = "net"
published = { velocity_rmse_all = [0.5, 0.25] }
set = { bundle = 2, pushed = 1, network = { kind = "gcn", hidden = 4, layers = 1 } }
[check]
data = { family = "cylinder-flow-small", train = 1, valid = 1, test = 1 }
set = { steps = 2, validate_every = 1, batch_size = 2, noise = 0.01, outputs = { fields = ["pressure"] } }
"""), "check")
    check_published(plan)
    jobs = jobs_in(tmp_path / "runs", plan, tmp_path / "data")
    carried_out(jobs["net", 0])
    found = gathered(plan, jobs, {"test": still([tmp_path / "data" / "test" / "0000.vtkhdf"])})
    off = [[(t * t - 1) / 16, n * (t - 1) / 16] for t in range(2, 9) for n in (2, 4)]
    idle = math.sqrt(sum(a * a + b * b for a, b in off) / (2 * len(off)))
    assert found.cells["nothing changes"]["test"]["velocity_rmse_all"].mean == pytest.approx(idle, rel=1e-6)
    assert found.figure == "velocity_rmse_all" and found.columns["valid_equal"].unit == "m/s" and "rmse_all" not in found.columns
    assert found.cells["net"]["test"]["velocity_rmse_all"].published == (0.5, 0.25) and found.cells["net"]["test"]["valid_equal"].mean > 0
    assert found.lines()[1:4:2] == ["RMSE-all on test [m/s]:", f"  {'nothing changes':40s} {idle:.3g}"] and set(found.cells) == {
        "net", "nothing changes"}
    head, row = (line for line in markdown(found).splitlines() if line.startswith(("|  |", "| nothing changes")))
    assert row.split("|")[head.split("|").index(" RMSE-all [m/s] ")] == f" {idle:.3g} "

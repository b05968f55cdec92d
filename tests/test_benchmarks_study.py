"""The table of a study: from the figures that lie in assets/, and nothing else."""

import json
import shutil

import pytest

from benchmarks import study
from tests.pages import ROOT

KEPT = ROOT / "assets" / "study-main"


def rows(capsys, monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["study", "main", *map(str, arguments)])
    study.main()
    return {cells[0]: cells[1:] for line in capsys.readouterr().out.splitlines() if (cells := line.strip("| ").split(" | "))}


def test_the_table_in_the_docs_is_what_the_kept_figures_say(capsys, monkeypatch):
    columns = ["gf_h", "mc", "rmse_1", "rmse_50", "rmse_all", "train_ms", "test_ms", "memory"]
    made = rows(capsys, monkeypatch, KEPT, "--columns", *columns)
    page = (ROOT / "docs" / "results.md").read_text()
    assert len(made) > 8 and all(" | ".join([name, *cells]) in page for name, cells in made.items() if not name.startswith("---"))


def test_a_cell_is_mean_and_sample_deviation_in_its_unit(tmp_path, capsys, monkeypatch):
    """Two seeds with 1 and 3 mm: 2 and the root of 2; a body that never moves has 4 mm."""
    shutil.copytree(KEPT, tmp_path / "kept")
    runs = tmp_path / "kept" / "runs"
    shutil.rmtree(runs / "GCN", ignore_errors=True)
    for seed, error in ((0, 1e-3), (1, 3e-3)):
        one = runs / "GCN" / str(seed)
        one.mkdir(parents=True)
        (one / "trained.json").write_text(json.dumps({"parameters": 5, "step_ms": 2.0, "memory": 9e6, "seconds": 7200}))
        (one / "on-test.json").write_text(json.dumps({"rmse_all": error, "ms_per_step_alone": 0.5}))
    (runs / "still-data.json").write_text(json.dumps({"rmse_all": 4e-3}))
    shutil.rmtree(runs / "MGN")
    made = rows(capsys, monkeypatch, tmp_path / "kept", "--columns", "rmse_all", "hours", "test_ms")
    assert "MGN" not in made and "BSMS-GNN" in made  # what has no seed has no row
    assert made["GCN"] == ["2 ± 1.4", "2 ± 0", "0.5 ± 0", "50.0%", "2"]
    assert made["nothing moves"] == ["4", "–", "–", "100.0%", "1"]


def test_a_folder_of_nothing_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["study", "main", str(tmp_path)])
    with pytest.raises(Exception, match="holds no study"):
        study.main()

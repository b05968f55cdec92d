"""What trained runs differ in, and when the difference of their errors is within its spread, worked out on paper."""

from types import SimpleNamespace

import pytest

from learning.config import TrainConfig
from learning.networks.m4gn import M4GNConfig
from learning.report import evaluate as module
from learning.report.differences import differing, spread_said
from tests.rows import row, rows


def test_only_what_differs_is_told_also_within_tables_and_of_keys_that_one_lacks():
    assert differing({"a": {"seed": 0, "noise": 1e-4, "network": {"hidden": 32, "heads": 4}, "frames": 5},
                      "b": {"seed": 1, "noise": 1e-4, "network": {"hidden": 64, "heads": 4}}}) == {
        "a": "seed 0, network.hidden 32, frames 5", "b": "seed 1, network.hidden 64, frames none"}
    assert differing({"a": {"noise": 3e-4}, "b": {"noise": 1e-4}, "c": {"noise": 1e-4}}) == {
        "a": "noise 0.0003", "b": "noise 0.0001", "c": "noise 0.0001"}
    assert differing({"a": {"seed": 0}}) == {"a": ""} and differing({"a": {"seed": 0}, "b": {"seed": 0}}) == {"a": "", "b": ""}


def test_a_difference_is_held_against_two_standard_errors_of_itself():
    """Differences 0.1, -0.05 and 0.55 mm: mean 0.2, sample deviation sqrt((0.01 + 0.0625 + 0.1225) / 2) = 0.3122, 2 s / sqrt(3) = 0.361."""
    said, = spread_said(rows())
    assert "M4GN a is 0.2 mm farther off than M4GN b (RMSD-all), on 3 trajectories; the spread of that mean is 0.361 mm" in said
    assert "within the spread" in said and "seed" not in said
    # 0.5, 0.7, 0.6: mean 0.6, deviation 0.1, spread 0.115
    far = [row("a", "foreign", 1.0, 8e-4, (6e-4, 9e-4, 9e-4)), row("b", "learned", 1.0, 2e-4, (1e-4, 2e-4, 3e-4))]
    said, = spread_said(far, chance=True)
    assert "a is 0.6 mm farther off than b" in said and "0.115 mm" in said
    assert "beyond the spread" in said and "nothing but their seed" in said
    one = [row("a", "learned", 1.0, 8e-4, (8e-4,)), row("b", "learned", 1.0, 2e-4, (2e-4,))]
    assert spread_said(one) == ["a is 0.6 mm farther off than b (RMSD-all); one trajectory does not say whether that is more than chance."]
    assert spread_said(rows()[1:]) == [] and spread_said(rows()[2:]) == []


@pytest.mark.parametrize("other, words, chance", [
    (TrainConfig(seed=1), ("seed 0", "seed 1"), True), (TrainConfig(noise=3e-4), ("noise 0.0001", "noise 0.0003"), False),
    (TrainConfig(network=M4GNConfig(walk=2)), ("network.walk 0, weights 7", "network.walk 2, weights 9"), False)])
def test_rows_of_runs_carry_what_differs_between_them(monkeypatch, tmp_path, other, words, chance):
    def model(config, weights):
        return SimpleNamespace(title="M4GN", config=config,
                               network=SimpleNamespace(parameters=lambda: [SimpleNamespace(numel=lambda: weights)]))

    monkeypatch.setattr(module, "read_stored", lambda path: ({"step": 40}, {}))
    monkeypatch.setattr(module, "paid_back", lambda rows, runs: rows)
    runs = {"x/a": model(TrainConfig(), 7), "x/b": model(other, 9 if other.network.walk else 7)}
    assert tuple(module._apart(runs).values()) == words and module._apart({"x/a": runs["x/a"]}) == {}

    kept = {}
    monkeypatch.setattr(module, "read_seen", lambda run: None)
    monkeypatch.setattr(module, "warm_up", lambda scene: None)
    found = SimpleNamespace(rows=rows(), notes=[], frames=[], hardest=None, solved_again=0.0)
    monkeypatch.setattr(module, "measure", lambda *given, **how: found)
    monkeypatch.setattr(module, "_facts", lambda *given: {})
    monkeypatch.setattr(module, "_limits", lambda *given: [])
    monkeypatch.setattr(module, "write_report", lambda out, report, shown: kept.update(report=report) or {"summary": ""})
    module.report_on([], [SimpleNamespace(name="c", known=None)], tmp_path, title="", runs=runs, refined=0)
    assert [each.about for each in kept["report"].rows] == [*words, "", "", "", ""]
    assert ("nothing but their seed" in kept["report"].notes[-1]) is chance and len(kept["report"].notes) == 1


def test_numbers_are_told_short_and_other_values_as_they_are():
    found = differing({"a": {"rate": 1e-4, "steps": 1000000, "deep": {"kind": "mgn"}}, "b": {"rate": 0.25, "steps": 30, "deep": {}}})
    assert found == {"a": "rate 0.0001, steps 1000000, deep.kind mgn", "b": "rate 0.25, steps 30, deep.kind none"}

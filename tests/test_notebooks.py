"""The notebooks run from top to bottom; their own asserts hold, and what they print is what is known of it from elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
NUMBER = r"(-?[\d.]+(?:e[+-]?\d+)?)"


def numbers(pattern: str, text: str) -> list[float]:
    """The numbers that stand where a pattern has NUMBER, in its only or first place."""
    found = re.search(pattern.replace("NUMBER", NUMBER), text)
    assert found, pattern
    return [float(number) for number in found.groups()]


def beam_to_report(text: str) -> None:
    assert numbers(r"^NUMBER steps in", text) == [60]
    # RMSD-1, RMSD-all [mm], residual, penetration [mm], det F
    network, still, truth = (numbers(rf"\n{name} +NUMBER +NUMBER +NUMBER +NUMBER +NUMBER", text)
                             for name in ("network", "nothing moves", "finite elements"))
    assert 0 < network[1] < still[1] and truth[:2] == [0, 0] and truth[2] < 1e-3
    # at rest a body is in equilibrium, with the axis of a cylinder of 10 mm half a millimetre from the middle of its sides
    assert still[2] < 1e-9 and 9 < still[3] <= 10 and still[4] == 1


def dataset(text: str) -> None:
    drawn = [float(length) for length in re.findall(r"draw \d: ([\d.]+) m", text)]
    assert len(drawn) == 3 and all(0.08 <= length <= 0.14 for length in drawn) and len(set(drawn)) == 3
    assert "'trajectories': 10, 'new': 10" in text
    ratio, error = numbers(r"NUMBER times smaller, largest error NUMBER m", text)
    assert ratio > 5 and 1e-8 < error <= 1e-6


def equilibrium(text: str) -> None:
    assert numbers(r"^NUMBER steps in", text) == [160]
    slow, fast = (numbers(rf"in {periods} periods the force of the first leg is off by up to NUMBER", text)[0] for periods in (40, 2))
    assert slow < 0.2 < fast  # in 40 periods of its first mode a beam all but follows its equilibria
    assert numbers(r"after the last touch the energy changes by NUMBER of itself", text)[0] < 1e-4


def flow_around_a_cylinder(text: str) -> None:
    # U_mean D / nu = 0.8 m/s x 0.1 m / 1e-3 m2/s; the drag of 2D-2, at a Reynolds number of 100, is 3.16 to 3.23 (Schäfer and Turek 1996)
    assert numbers(r"Reynolds number NUMBER", text) == [80]
    assert numbers(r"drag coefficient NUMBER", text)[0] == pytest.approx(3.2, abs=0.2)
    modes, data = numbers(r"\nStrouhal number +– +NUMBER", text), numbers(r"\nStrouhal number .* NUMBER\n", text)
    assert modes[0] == pytest.approx(data[0], rel=0.1) and 0.25 < data[0] < 0.32  # 0.295 to 0.305 at 100


def modal_analysis(text: str) -> None:
    # f = (1.8751 / L)^2 sqrt(E I / rho A) / 2 pi with L = 0.1 m, E = 1e6 Pa, rho = 1000 kg/m3, I / A = 0.02^2 / 12 m2
    first, second = (numbers(rf"\n +{i} +NUMBER +NUMBER +NUMBER\n", text) for i in (1, 2))
    assert first[1] == second[1] == pytest.approx(10.217, abs=1.1e-3)
    assert first[0] == pytest.approx(10.049, rel=0.03) and first[2] < 1e-8  # converged value; 6 cells across
    assert numbers(r"\{'prism': NUMBER, 'hexahedron': NUMBER\} Hz in the limit", text) == pytest.approx([10.049] * 2, rel=5e-3)
    # 21 x 5 x 5 nodes, and 41 x 9 x 9 with the edges' middles, less those of the held face, three unknowns each
    assert numbers(r"order 1: NUMBER Hz with NUMBER unknowns", text)[1] == 3 * 20 * 25
    assert numbers(r"order 2: NUMBER Hz with NUMBER unknowns", text)[1] == 3 * 40 * 81
    assert numbers(r"those of an endless strip start at NUMBER", text) == [58.71]  # (pi / 0.41)^2


def read_a_report(text: str) -> None:
    found = {name: float(value) for name, value in re.findall(rf"\n?(\w+) +{NUMBER}\n", text)}
    assert 0.5 < found["effectivity"] < 2 and 1 <= found["worst_step"] <= 40
    assert found["rmsd_all_all_nodes"] < found["rmsd_all"] < 1e-2
    steps = [[float(number) for number in line] for line in re.findall(rf"\n +(\d) +{NUMBER} +{NUMBER}", text)]
    assert [count for count, _, _ in steps] == [0, 1, 2, 3, 4, 5]
    assert steps[5][1] < 1e-3 * steps[0][1] and steps[5][2] < 1e-3 * steps[0][2]
    once, twice = (numbers(rf"\n{count} a frame: NUMBER mm", text)[0] for count in (1, 2))
    before = 1e3 * found["rmsd_all_all_nodes"]  # [mm]
    assert once < 0.1 * before and twice < min(once, 0.01 * before)  # an order of magnitude each


CHECKS = {check.__name__: check for check in (beam_to_report, dataset, equilibrium, flow_around_a_cylinder, modal_analysis, read_a_report)}


@pytest.mark.parametrize("notebook", sorted((ROOT / "notebooks").glob("*.py")), ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_is_known(notebook, tmp_path):
    environment = os.environ | {"MPLBACKEND": "Agg", "NOTEBOOK_TRAINING_SECONDS": "15"}
    run = subprocess.run([sys.executable, "-W", "error::SyntaxWarning", notebook], cwd=ROOT, env=environment, text=True,
                         capture_output=True)
    assert run.returncode == 0, run.stderr[-2000:]
    CHECKS[notebook.stem](run.stdout)


def test_notebooks_are_scripts_with_cells():
    import jupytext

    for path in (ROOT / "notebooks").glob("*.py"):
        kinds = [cell.cell_type for cell in jupytext.read(path).cells]
        assert kinds[0] == "markdown" and "code" in kinds
    assert not list(ROOT.glob("notebooks/*.ipynb"))

"""The notebooks run from top to bottom; their own asserts hold."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("notebook", sorted((ROOT / "notebooks").glob("*.py")), ids=lambda path: path.stem)
def test_notebook_runs(notebook, tmp_path):
    environment = os.environ | {"MPLBACKEND": "Agg", "NOTEBOOK_TRAINING_SECONDS": "15"}
    run = subprocess.run([sys.executable, "-W", "error::SyntaxWarning", notebook], cwd=ROOT, env=environment, text=True,
                         capture_output=True)
    assert run.returncode == 0, run.stderr[-2000:]
    assert run.stdout.count("\n") > 5


def test_notebooks_are_scripts_with_cells():
    import jupytext

    for path in (ROOT / "notebooks").glob("*.py"):
        kinds = [cell.cell_type for cell in jupytext.read(path).cells]
        assert kinds[0] == "markdown" and "code" in kinds
    assert not list(ROOT.glob("notebooks/*.ipynb"))

"""Ways in: version, completion in a real bash, an example for every verb, `python -m fidelity`, and what `run` says elsewhere."""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tomllib

import pytest

import fidelity
from datagen.files.provenance import commit
from datagen.ways import EXAMPLES, words_after
from tests.pages import ROOT

VERBS = [verb for verb, _ in words_after(fidelity._parser(), "") if verb not in ("", "dataset")]


def test_the_version_is_that_of_the_project_and_names_the_commit(capsys):
    with pytest.raises(SystemExit) as stop:
        fidelity.main(["--version"])
    release = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert stop.value.code == 0 and capsys.readouterr().out == f"fidelity {release} ({commit()})\n"


def completed(*words: str) -> list[str]:
    """What bash offers after these words, the last of which is being typed."""
    script = (f"source <({sys.executable} -m fidelity --completion); COMP_WORDS=(fidelity {shlex.join(words)}); "
              f"COMP_CWORD={len(words)}; _fidelity; printf '%s\\n' \"${{COMPREPLY[@]}}\"")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(["bash", "-c", script], cwd=ROOT, env=environment, capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.parametrize("words, offered", [
    (["mo"], ["modes"]), (["dataset", "un"], ["unpack"]), (["modes", "--ki"], ["--kind"]), (["modes", "lap"], ["laplacian"]),
    (["dataset", "pack", "--tol"], ["--tolerance"]), (["simulate", "press.toml", "--s"], ["--set"]), (["nothing", "--"], [])])
def test_a_shell_completes_verbs_options_and_choices(words, offered):
    assert completed(*words) == offered


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_one_example_in_its_help_that_it_takes(verb, capsys):
    with pytest.raises(SystemExit) as stop:
        fidelity.main([*verb.split(), "--help"])
    line, = re.findall(r"^example:\n  fidelity (.*)$", capsys.readouterr().out, re.MULTILINE)
    assert stop.value.code == 0 and line.startswith(f"{verb} ")
    options = fidelity._parser().parse_args(shlex.split(line))
    assert isinstance(options, argparse.Namespace) and set(EXAMPLES) == set(VERBS)


def test_it_runs_as_a_module_from_elsewhere(tmp_path):
    done = subprocess.run([sys.executable, "-m", "fidelity", "view", "none.vtkhdf"], cwd=tmp_path,
                          env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", "fidelity: none.vtkhdf: no such file\n")


@pytest.mark.parametrize("release, words", [
    ('ID=ubuntu\nVERSION_ID="24.04"\nPRETTY_NAME="Ubuntu 24.04 LTS"', "this is Ubuntu 24.04 LTS, whose FEniCSx is another version"),
    ("ID=fedora\nVERSION_ID=40\nPRETTY_NAME=Fedora", "this is Fedora; Debian 12 and 13"),
    (None, "this is macOS, which has no Debian packages")])
def test_elsewhere_run_says_which_command_helps(tmp_path, release, words):
    """A system is what its file says; macOS has none, and a `uname` of its own."""
    if release:
        (tmp_path / "os-release").write_text(release)
    (tmp_path / "uname").write_text("#!/bin/sh\necho Darwin\n")
    (tmp_path / "uname").chmod(0o755)
    environment = {"PATH": f"{tmp_path}:/usr/bin:/bin", "OS_RELEASE": str(tmp_path / "os-release")}
    done = subprocess.run([ROOT / "run", "--version"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and done.stdout == "" and done.stderr.startswith(f"run: {words}") and done.stderr.count("\n") == 1
    assert "docker build -t fidelity . && docker run" in done.stderr


def test_the_dockerfile_sets_up_by_run_itself_and_names_what_run_names():
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    steps = [line for line in lines if line and not line.startswith("#")]
    assert [line.split()[0] for line in steps] == ["ARG", "FROM", "ARG", "COPY", "RUN", "WORKDIR", "ENTRYPOINT"]
    assert "/opt/fidelity/run --version" in steps[4] and "apt-get" not in steps[4] and "pip install" not in steps[4]
    told = re.search(r"^container='(.*)'$", (ROOT / "run").read_text(), re.MULTILINE)[1]
    for command in told.split(" && "):
        assert f"#   {command}" in lines

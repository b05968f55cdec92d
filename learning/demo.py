"""The whole line on one small data set: modes, trajectories, segments, trainings, rollouts, report.

Everything lands in one folder. What a former, interrupted run has finished there is kept; a training goes on from its
last checkpoint.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from datagen.family.family import counts, draw, load_family
from datagen.files.trajectory import read_trajectory
from datagen.sets.dataset import files, read_manifest
from datagen.sets.generate import generate
from learning.config import SlenderConfig, TrainConfig, load_config
from learning.report.evaluate import evaluate
from learning.samples.samples import segments_of
from learning.segments.quality import segment_quality
from learning.training.sections import train_sections
from learning.training.train import train
from physics.modes.elastic import elastic_modes, euler_bernoulli_hz

CONFIG, FAST = (Path(__file__).parent / "configs" / f"{name}.toml" for name in ("m4gn-small", "sections-small"))


def run(out: Path, *, say: Callable[[str], None], training_steps: int | None = None) -> dict[str, Any]:
    """Make the demonstration in a folder; `say` takes what there is to read. Returns what evaluate() returns, and "seconds".

    training_steps: instead of those in learning/configs/m4gn-small.toml and, at most, sections-small.toml
    """
    started = time.perf_counter()
    family, data = load_family("demo"), out / "data"

    say("\n1  Elastic modes of the first beam, clamped at one end")
    scene = draw(family, 0, 0)
    modes = elastic_modes(scene, count=4)
    theory = euler_bernoulli_hz(scene, 4)
    for i, (hz, expected) in enumerate(zip(modes.frequencies_hz, theory, strict=True)):
        say(f"   mode {i + 1}  {hz:8.3f} Hz   Euler-Bernoulli bending {expected:8.3f} Hz   residual {modes.residuals[i]:.0e}")
    say("   (theory knows neither torsion nor shear: from the third on the two part)")

    say("\n2  Beams pressed by a rigid cylinder, solved by finite elements")
    generate(family, counts(family), data)
    manifest = read_manifest(data)
    nodes, seconds = np.mean([entry.nodes for entry in manifest.trajectories]), sum(entry.seconds for entry in manifest.trajectories)
    steps = sum(entry.steps for entry in manifest.trajectories)
    say(f"   {len(manifest.trajectories)} trajectories of {nodes:.0f} nodes on average, {1e3 * seconds / steps:.1f} ms a step: {data}")

    config = load_config(CONFIG)
    assert isinstance(config, TrainConfig)
    if training_steps is not None:
        config = replace(config, steps=training_steps)
    say(f"\n3  Segments: METIS, then refined by the first elastic mode and the distance to the obstacle ({config.method})")
    first = read_trajectory(files(data, "train")[0])
    for method in ("metis", config.method):
        label = segments_of(first, replace(config, method=method))
        quality = segment_quality(first, label)
        say(f"   {method:12s} " + ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in quality.items()))

    say(f"\n4  M4GN, trained for {config.steps} steps on {len(files(data, 'train'))} trajectories")
    trained = out / "run"
    result = train(config, files(data, "train"), files(data, "valid"), trained, resume=(trained / "last.safetensors").exists())
    error = "none, every rollout blew up" if result["best_error"] is None else f"{1e3 * result['best_error']:.3f} mm"
    say(f"   {result['parameters']} weights, {result['steps']} steps in {result['seconds']:.0f} s, validation error {error}: {trained}")

    fast = load_config(FAST)
    assert isinstance(fast, SlenderConfig)
    say(f"\n5  Beam theory, and a network for what it leaves over, trained for {fast.steps} steps on the same trajectories")
    sections = out / "fast"
    result = train_sections(fast, files(data, "train"), files(data, "valid"), sections, steps=training_steps,
                            resume=(sections / "last.safetensors").exists())
    say(f"   {result['parameters']} weights, {result['steps']} steps in {result['seconds']:.0f} s, validation error "
        f"{1e3 * result['best_error']:.3f} mm: {sections}")

    say("\n6  Rollouts of the test beams, held against finite elements")
    report = evaluate(trained, files(data, "test"), out / "report", beside=[sections], say=lambda line: say("   " + line))
    seconds = time.perf_counter() - started
    say(f"\nAll of it took {seconds:.0f} s. Open {out / 'report' / 'report.html'}")
    return {**report, "seconds": seconds}

"""Cut the mesh of a trajectory file into segments, write them into it, and say how good they are."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from datagen.files.trajectory import read_sound, write_trajectory
from learning.segments.cut import segment
from learning.segments.quality import auto_segment, segment_quality


def segment_file(path: str | Path, count: int | str, picture: Path | None, say: Callable[[str], None], **how: Any) -> dict[str, Any]:
    """Segment a file.

    Args:
        count: K, or "auto"
        picture: a PNG of the segments on the body at rest
        say: takes lines for the reader
        how: method, tau, modes and mode_count of `segment`

    Returns:
        number of segments, nodes of each, their quality, the silhouettes that "auto" compared, seconds

    Raises:
        InputError: no sound file, or a mesh that cannot be segmented so
    """
    trajectory = read_sound(path, complete=False)
    scores: dict[int, float] = {}
    started = time.perf_counter()
    if isinstance(count, int):
        label = segment(trajectory, count=count, **how)
    else:
        label, scores = auto_segment(trajectory, **how)
    seconds = time.perf_counter() - started
    write_trajectory(path, replace(trajectory, segment=label))
    own = label[trajectory.body].astype(np.int64)
    nodes, quality = np.bincount(own).tolist(), segment_quality(trajectory, label)
    for number, score in scores.items():
        say(f"{number:5d} segments: silhouette {score:.3f}")
    say(f"{len(nodes)} segments of {min(nodes)} to {max(nodes)} nodes, "
        + ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in quality.items()) + f": {path}")
    if picture is not None:
        from physics.view import ObstacleSurface, segment_picture

        surface = None if trajectory.obstacle is None else ObstacleSurface(*trajectory.obstacle).at(0)
        segment_picture(picture, trajectory.mesh, own, obstacle=surface)
        say(f"picture: {picture}")
    return {"segments": len(nodes), "nodes": nodes, **quality, "silhouette_of": scores, "seconds": seconds}

"""Data: families of scenes, trajectory files, and folders of them.

    files/    one trajectory on disk: its format, read and written; records of other programs, predictions, where a number comes from
    family/   what scenes are drawn
    flow/     flows in place of solids
    sets/     a folder of trajectories: planned, made, checked, described, packed, exchanged
    scene_verbs, verbs   the command line's verbs on scenes, and on folders of trajectories
    ways      the command line's version, examples and completion

It imports physics, and nothing of learning. What a user calls is importable from here:
`from datagen import load_family, generate, read_trajectory`.
"""

from importlib import import_module
from typing import Any

_PUBLIC = {
    "Family": "family.family", "Trajectory": "files.trajectory", "as_solved": "files.solved", "check": "sets.check",
    "counts": "family.family", "draw": "family.family", "export_records": "sets.deepmind", "generate": "sets.generate",
    "import_records": "sets.deepmind", "inputs_of": "files.inputs", "load_family": "family.family", "pack": "sets.pack",
    "predicted": "files.inputs", "read_manifest": "sets.dataset", "read_trajectory": "files.trajectory",
    "statistics": "sets.statistics", "trajectory_of": "sets.generate", "unpack": "sets.pack",
    "verify_files": "flow.prediction", "write_trajectory": "files.trajectory",
}
__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'datagen' has no attribute {name!r}")
    return getattr(import_module(f"datagen.{_PUBLIC[name]}"), name)

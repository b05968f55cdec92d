"""What a training is asked to do: its frozen dataclass is the schema, the defaults and the documentation of a TOML file.

The defaults are the paper's for DeformingBeam, but for the overlap of segments; `configs/m4gn-beam.toml` writes the paper's out,
`configs/m4gn-small.toml` is the demo's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from learning.graphs.layout import LENGTHS
from learning.networks.kinds import CONFIGS, NetworkConfig
from learning.networks.m4gn import M4GNConfig
from learning.networks.sections import SectionsConfig
from learning.networks.shapes import ShapesConfig
from learning.segments.features import METHODS, MODES
from physics.schema import InputError, nearest, quantity, read_table, read_toml, shown

SCHEMES = ("step", "pose")


@dataclass(frozen=True, kw_only=True)
class NetworkInputs:
    """What a network sees beside the state of a body.

    material: Young's modulus, Poisson's ratio, density and law, told at every node; of bodies of one isotropic material
    lengths: what all lengths are counted in, this config's own too: m, the cell size of each body (the median length of its edges), or its
        size (its largest extent)
    """

    material: bool = False
    lengths: str = quantity("m", choice=LENGTHS)


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """What a network predicts beside the state of a body or a fluid.

    fields: of the trajectories, told at every node of the body as they are in the frame to come: ["stress"], ["pressure"]
    """

    fields: tuple[str, ...] = quantity(())


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Segments, graph, noise and schedule of one training.

    scheme: step: the way from one frame to the next; pose: where the body is, straight from the obstacle's pose
    history: 1 to show the last velocity too
    estimate: correct an estimate of the reduced-order model rather than predict from nothing
    frames: that are learned from in each trajectory, evenly spaced; all by default
    bundle: frames that are told at once
    pushed: how many of its own predictions lie in the mean behind a frame from which the network learns to go on
    segments: how many, for networks that see them; "auto" picks the number for each body by its silhouette
    method: how segments are cut
    tau: weight of place against obstacle and modes in the cut
    modes: which modes the cut looks at
    mode_count: how many of them at least
    overlap: 1 to let a node also belong to the segments of its mesh neighbours
    contact_radius: the largest distance of a contact edge
    noise: standard deviation of the disturbance of each component of a free node's position
    batch_size: frames in a training step
    steps: training ends here, or at budget_seconds
    budget_seconds: of training, reading the data not counted; train --seconds sets it
    learning_rate: kept for the first half, then falling exponentially to final_learning_rate
    final_learning_rate: at the end
    clip_norm: largest norm of the gradient of all weights together
    validate_every: steps between checkpoints, each with a rollout of every validation trajectory
    seed: of weights, draws and noise
    """

    scheme: str = quantity("step", choice=SCHEMES)
    history: int = quantity(0, at_least=0, at_most=1)
    estimate: bool = False
    frames: int | None = quantity(None, at_least=1)
    bundle: int = quantity(1, at_least=1, at_most=100)
    pushed: int = quantity(0, at_least=0, at_most=100)
    segments: int | str = quantity(19, at_least=1, at_most=100_000, choice=("auto",))
    method: str = quantity("slic-mdod-e", choice=METHODS)
    tau: float = quantity(0.5, at_least=0)
    modes: str = quantity("elastic", choice=MODES)
    mode_count: int = quantity(1, at_least=1, at_most=100)
    overlap: int = quantity(0, at_least=0, at_most=1)
    network: NetworkConfig = field(default_factory=M4GNConfig)
    inputs: NetworkInputs = field(default_factory=NetworkInputs)
    outputs: Outputs = field(default_factory=Outputs)
    contact_radius: float = quantity(0.002, unit="m", above=0)
    noise: float = quantity(1e-4, unit="m", at_least=0)
    batch_size: int = quantity(8, at_least=1, at_most=10_000)
    steps: int = quantity(1_000_000, at_least=1)
    budget_seconds: float | None = quantity(None, unit="s", above=0)
    learning_rate: float = quantity(1e-4, above=0)
    final_learning_rate: float = quantity(1e-6, above=0)
    clip_norm: float = quantity(1.0, above=0)
    validate_every: int = quantity(10_000, at_least=1)
    seed: int = quantity(0, at_least=0)

    def __post_init__(self) -> None:
        """Raises `InputError` for a history beside something that replaces it, and for overlap that the network cannot do with."""
        if self.history and (self.scheme == "pose" or self.estimate):
            raise InputError('history = 1: goes with scheme = "step" without an estimate; a pose has no past, and an estimate '
                             "tells the velocity")
        for name, asked in (("pushed", self.pushed), ("bundle", self.bundle > 1)):
            if asked and (self.scheme == "pose" or self.estimate or self.history):
                raise InputError(f'{name}: goes with scheme = "step", without history and estimate')
        if self.overlap and not self.network.wants.overlap:
            raise InputError(f'overlap = 1: goes with a network that takes overlapping segments, [network] kind = "m4gn", '
                             f'not "{self.network.kind}"')


@dataclass(frozen=True, kw_only=True)
class PosesConfig:
    """What a training of a predictor is asked to do that knows all poses of a path at once (slender/, bodies/).

    frames: that are learned from in each trajectory, evenly spaced from the first touch on
    poses: at which a path is predicted; splines lead from one to the next
    batch_size: poses in a training step
    learning_rate: of AdamW, falling to zero by a cosine
    weight_decay: of AdamW
    clip_norm: largest norm of the gradient of all weights together
    steps, budget_seconds: training ends at whichever is reached first, and so does the cosine; reading the data is not counted
    validate_every: steps between checkpoints
    coverage: share of validation frames that the error bar shall cover
    unsure_above: a frame is unsure when its error bar is longer
    seed: of weights and draws
    """

    frames: int = quantity(50, at_least=2)
    poses: int = quantity(32, at_least=4, at_most=1000)
    batch_size: int = quantity(96, at_least=1, at_most=100_000)
    steps: int = quantity(1_000_000, at_least=1)
    budget_seconds: float | None = quantity(None, unit="s", above=0)
    learning_rate: float = quantity(2e-3, above=0)
    weight_decay: float = quantity(1e-2, at_least=0)
    clip_norm: float = quantity(1.0, above=0)
    validate_every: int = quantity(1000, at_least=1)
    coverage: float = quantity(0.9, above=0, below=1)
    unsure_above: float = quantity(3e-4, unit="m", above=0)
    seed: int = quantity(0, at_least=0)


@dataclass(frozen=True, kw_only=True)
class SlenderConfig(PosesConfig):
    """Of a predictor of beams, `[network] kind = "sections"`."""

    network: SectionsConfig = field(default_factory=SectionsConfig)


@dataclass(frozen=True, kw_only=True)
class BodiesConfig(PosesConfig):
    """Of a predictor of bodies of any shape, `[network] kind = "shapes"`.

    mirrored: axes of which training shows mirrored copies, as "xy"
    """

    mirrored: str = ""
    network: ShapesConfig = field(default_factory=ShapesConfig)

    def __post_init__(self) -> None:
        """Raises `InputError` for an axis that is none."""
        if len(set(self.mirrored) & set("xyz")) < len(self.mirrored):
            raise InputError(f"mirrored = {self.mirrored!r}: must be some of the letters x, y, z, each once")


KINDS: dict[str, type[PosesConfig]] = {"sections": SlenderConfig, "shapes": BodiesConfig}


def load_config(path: str | Path) -> TrainConfig | PosesConfig:
    """A config from a TOML file, of the kind that its network is. Raises `InputError` in one line when anything about it is wrong."""
    table = read_toml(path)
    network = table.get("network")
    kind = network.get("kind", "m4gn") if isinstance(network, dict) else "m4gn"
    known = (*CONFIGS, *KINDS)
    if kind not in known:
        raise InputError(f"{path}: network.kind = {shown(kind)}: must be one of {', '.join(known)}{nearest(str(kind), known)}")
    config: type[TrainConfig] | type[PosesConfig] = KINDS.get(kind, TrainConfig)
    try:
        return read_table(config, table)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None

"""What the networks are made of: multi-layer perceptrons, a step of message passing, rows padded by their owner, arithmetic.

The first layer of an edge MLP is linear in [e, h_i, h_j], so W [e, h_i, h_j] = W_e e + (W_i h)_i + (W_j h)_j: the
products with h are taken once for each node rather than once for each edge. This is exact, up to the order of the sums.

Arithmetic is float32 throughout with precision = "float32". "medium" is torch's word for products of float32 matrices that may
be rounded to bfloat16 inside: processors that multiply bfloat16 in tiles (AMX) do that, others multiply float32 by another
library, which is twice as fast on AMD's. With "bfloat16" layers take and give bfloat16 (8 bits of mantissa); weights, sums
over edges and segments, and the output are float32.

Sums over edges are torch's own index_add. torch_geometric would bring the same sums under other names (without its compiled
torch_scatter it calls them, too), and neither its message passing, which gathers the inputs of every edge side by side, nor its
pooling, so nothing of it is used.

Legend: N nodes, E edges, W contact edges, H hidden size.
Source: Pfaff et al. 2021 (arXiv:2010.03409), section 3.2.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar, Protocol

import torch
from torch import Tensor, nn
from torch.nn.functional import linear

from learning.graphs.graph import Graph

PRECISIONS = ("float32", "medium", "bfloat16")


class Precise(Protocol):
    """A network's config."""

    @property
    def precision(self) -> str: ...


class Network(nn.Module):
    """Normalised velocity of every node from a normalised graph.

    title: in reports
    told_by_sizes: all that is done with a graph is told by the sizes of its tensors, so that a GPU can replay it
    """

    title: ClassVar[str]
    told_by_sizes: ClassVar[bool] = False

    def __init__(self, config: Precise) -> None:
        super().__init__()
        self.reduced = config.precision == "bfloat16"

    def forward(self, graph: Graph) -> Tensor:
        """(N, D + F) normalised velocity and further fields (graphs/layout.py); meaningless where nothing is asked."""
        with torch.autocast(graph.node.device.type, torch.bfloat16, enabled=self.reduced):
            return self.velocity(graph).float()

    def velocity(self, graph: Graph) -> Tensor:
        """The same, in whatever precision the layers have."""
        raise NotImplementedError

    @property
    def last(self) -> nn.Linear:
        """The layer that the output comes from: with zeros in it the network says nothing."""
        raise NotImplementedError


def told_by_sizes(network: nn.Module) -> bool:
    """Whether a GPU can replay it; of one of somebody else's that is not known."""
    return bool(getattr(network, "told_by_sizes", False))


@contextmanager
def products(config: Precise) -> Iterator[None]:
    """Products of matrices in a network's precision for the time of the block, backward passes included."""
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("medium" if config.precision == "medium" else "highest")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)


class MLP(nn.Module):
    """Three linear layers with ReLU between them, and LayerNorm at the end unless told otherwise.

    affine: LayerNorm has a scale and a shift to learn
    """

    def __init__(self, inputs: int, hidden: int, outputs: int, *, norm: bool = True, affine: bool = True) -> None:
        super().__init__()
        self.first = nn.Linear(inputs, hidden)
        self.second = nn.Linear(hidden, hidden)
        self.third = nn.Linear(hidden, outputs)
        self.norm = nn.LayerNorm(outputs, elementwise_affine=affine) if norm else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        """(M, inputs) to (M, outputs)."""
        return self.after_first(self.first(x))

    def after_first(self, y: Tensor) -> Tensor:
        """What follows the first linear layer."""
        return self.norm(self.third(self.second(y.relu_()).relu_()))

    def on_edges(self, e: Tensor, h: Tensor, pair: Tensor) -> Tensor:
        """The same as forward([e, h_sender, h_receiver]), with the first layer factorised: (E, H)."""
        of_edge, of_sender, of_receiver = self.first.weight.split([e.shape[1], h.shape[1], h.shape[1]], dim=1)
        y = linear(e, of_edge, self.first.bias)
        return self.after_first(y + project(h, of_sender, pair[0]) + project(h, of_receiver, pair[1]))


def project(h: Tensor, weight: Tensor, index: Tensor) -> Tensor:
    """(W h)[index], in the cheaper order: (E, H)."""
    if len(index) > len(h):
        return linear(h, weight).index_select(0, index)
    return linear(h.index_select(0, index), weight)


class MessagePassing(nn.Module):
    """One step: edges from their ends, then nodes from the sums of their incoming edges; residual on all three."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.mesh = MLP(3 * hidden, hidden, hidden)
        self.contact = MLP(3 * hidden, hidden, hidden)
        self.node = MLP(3 * hidden, hidden, hidden)

    def forward(self, h: Tensor, e: Tensor, mesh_pair: Tensor, w: Tensor,
                contact_pair: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Latents of nodes, mesh edges and contact edges after the step."""
        e = e + self.mesh.on_edges(e, h, mesh_pair)
        w = w + self.contact.on_edges(w, h, contact_pair)
        sums = [sum_at(pair[1], latent, len(h)) for pair, latent in ((mesh_pair, e), (contact_pair, w))]
        return h + self.node(torch.cat([h, *sums], dim=1)), e, w


def sum_at(index: Tensor, values: Tensor, count: int) -> Tensor:
    """(count, H) float32 sums of the rows of values (M, H) that have the same index (M,)."""
    return torch.zeros(count, values.shape[1], device=values.device).index_add(0, index, values.float())


def number_at(index: Tensor, count: int) -> Tensor:
    """(count,) how often each number is in index (M,); as bincount, which waits for a GPU to know the largest."""
    return torch.zeros(count, dtype=index.dtype, device=index.device).index_add(0, index, torch.ones_like(index))


class Padding:
    """Rows of a table side by side with those of the same owner, padded to the most that any has.

    present: (B, S) False on padding
    """

    def __init__(self, owner: Tensor, owners: int, most: int = 0) -> None:
        """owner: (M,) from 0 to B - 1; rows of one owner keep their order. most: what no owner has more of; by default counted."""
        count = number_at(owner, owners)
        order = owner.argsort(stable=True)
        self._owner, self._slot = owner, torch.empty_like(owner)
        self._slot[order] = torch.arange(len(owner), device=owner.device) - (count.cumsum(0) - count)[owner[order]]
        self.present = torch.arange(most or int(count.max()), device=owner.device) < count[:, None]
        self.count = count

    def padded(self, x: Tensor) -> Tensor:
        """(B, S, H) from (M, H), zero on padding."""
        table = x.new_zeros(*self.present.shape, x.shape[1])
        table[self._owner, self._slot] = x
        return table

    def listed(self, table: Tensor) -> Tensor:
        """(M, H) from (B, S, H)."""
        return table[self._owner, self._slot]

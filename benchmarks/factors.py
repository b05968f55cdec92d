"""What the own factors gain over MUMPS and CHOLMOD: the press scene with each of them, at three sizes.

    .venv/bin/python -m benchmarks.factors           1.5 k, 5 k and 15 k nodes, some minutes

The first steps of the press scene's 400, after the obstacle has touched, set-up left out. All factor the same stiffness, are kept
and renewed by the same rule, and answer the same questions of contact; only the program differs that factors and solves. MUMPS and
CHOLMOD are PETSc's, each with its own ordering, and their compliance columns are whole solutions; the own factors stop half-way
(physics/linalg/columns.py). Single is the precision that a dissected factor begins with; all others are double. A factorisation has the
stiffness in it. Each run is a process of its own.
"""

from petsc4py import PETSc

from benchmarks import footing
from physics.equilibrium import tangent
from physics.equilibrium.path import LoadPath
from physics.linalg.cholesky import BandFactor, DissectionFactor, NotPositiveDefinite, narrowest_order
from physics.linalg.indefinite import SparseFactor
from physics.mesh.build import build_mesh

SIZES = (((40, 5, 5), 60), ((60, 8, 8), 20), ((90, 12, 12), 8))


class Cholmod(SparseFactor):
    """CHOLMOD's supernodal L L^T."""

    name = "CHOLMOD"

    def __init__(self, elasticity) -> None:
        super().__init__(elasticity)
        self._pc.setFactorSolverType("cholmod")

    def update(self, u) -> None:
        self.learned = []
        matrix = self.elasticity.stiffness(u)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._pc.setOperators(matrix)
        try:
            self._pc.setUp()
        except PETSc.Error:
            raise NotPositiveDefinite("the stiffness cannot be factored") from None
        self._vectors = self._vectors or matrix.createVecs()


KINDS = {"own, multifrontal": DissectionFactor, "own, multifrontal, single": lambda elasticity: DissectionFactor(elasticity, single=True),
         "own, banded": lambda elasticity: BandFactor(elasticity, *narrowest_order(elasticity)),
         "MUMPS": SparseFactor, "CHOLMOD": Cholmod}


def one(kind: str, cells: list[int], steps: int) -> dict:
    """The first steps with one kind of factor."""
    tangent.solver_for = lambda elasticity, **choice: KINDS[kind](elasticity)
    path = LoadPath(footing.press(cells), build_mesh(footing.press(cells).body))
    path.advance(1 / 400)
    seconds, taken = footing.cost(lambda: sum(path.advance(step / 400).iterations for step in range(2, steps + 2)))
    u, factor = path.states[-1].u, path.newton.tangent.solver
    assert isinstance(factor, type(KINDS[kind](path.balance.elasticity)))
    force = path.balance.elasticity.force(u)
    made = path.newton.factorisations
    return {"nodes": len(u), "ms": 1e3 * seconds / steps, "iterations": taken, "made": made, "largest": float(abs(u).max()),
            "factor": 1e3 * footing.least(lambda: factor.update(u), 3), "solution": 1e3 * footing.least(lambda: factor.solve(force), 5)}


def main() -> None:
    footing.parser(__doc__).parse_args()
    table = footing.Table()
    for cells, steps in SIZES:
        found = {kind: footing.child(one, kind, cells, steps) for kind in KINDS}
        largest, own = [row["largest"] for row in found.values()], next(iter(found.values()))
        assert max(largest) < min(largest) * (1 + 1e-5)
        for kind, row in found.items():
            table.add({"nodes": row["nodes"], "factor": kind, "ms a step": row["ms"], "over multifrontal": f"{row['ms'] / own['ms']:.2f}",
                       "a factorisation [ms]": row["factor"], "a solution [ms]": row["solution"], "Newton steps": row["iterations"],
                       "factorisations": row["made"]})


if __name__ == "__main__":
    main()

"""The lowest eigenpairs, with a factor up to a number of unknowns and by multigrid above."""

from __future__ import annotations

from dataclasses import replace

from physics.linalg.eigen.direct import with_factor
from physics.linalg.eigen.iterated import with_multigrid
from physics.linalg.eigen.pairs import Pairs, Problem

DIRECT = {2: 1_000_000, 3: 150_000}  # unknowns up to which a factor is made, by the dimension of the body


def lowest_pairs(problem: Problem, count: int, *, method: str | None = None) -> Pairs:
    """The `count` lowest pairs; `method` "direct" or "multigrid" overrides the choice by size.

    Raises:
        RuntimeError: fewer pairs were found than asked for, or fewer zeros than must be there
    """
    unknowns, limit = _total(problem), DIRECT[problem.dimension]
    method = method or ("direct" if unknowns <= limit else "multigrid")
    why = f"{unknowns} unknowns in {problem.dimension}-D, {'at most' if unknowns <= limit else 'more than'} {limit}"
    pairs = with_factor(problem, count, unknowns) if method == "direct" else with_multigrid(problem, count, unknowns)
    if pairs.zeros < min(problem.zeros, count):
        raise RuntimeError(f"{pairs.zeros} zero eigenvalues found where the supports leave {problem.zeros}: "
                           f"the lowest are {', '.join(f'{value:.3g}' for value in pairs.values[:8])}")
    return replace(pairs, solver=f"{pairs.solver} ({why})")


def _total(problem: Problem) -> int:
    vector = problem.stiffness.createVecRight()
    vector.array[:] = problem.free
    return round(vector.sum())

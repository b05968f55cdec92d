"""How are K x = b and K x = lambda M x solved? Nothing here knows what a body is: matrices, a graph, and coordinates.

    stiffness    what a solver asks of a body
    native       C++ compiled once and kept
    ordering/    nested dissection: a numbering of little fill
    dissection   the multifrontal Cholesky factor in that numbering (dissection.cpp)
    columns      the compliance: what unit forces do, kept as long as a factor
    cholesky     banded and dissected factors of a positive definite stiffness
    indefinite   MUMPS's factor of any stiffness
    rows         what share of a stiffness a process has
    multigrid    conjugate gradients where a factor is too large
    factor       which of these factors a body gets, and what a factor can do
    eigen/       the lowest eigenpairs
"""

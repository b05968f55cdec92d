"""How are K x = b and K x = lambda M x solved? Nothing here knows what a body is: matrices, a graph, and coordinates.

    stiffness    what a solver asks of a body
    native       C++ compiled once and kept
    dissection   a numbering of little fill, and the multifrontal Cholesky factor (dissection.cpp)
    columns      what unit forces do, kept as long as a factor
    factor       banded, dissected and general factors behind one interface
    multigrid    conjugate gradients where a factor is too large
    eigen        the lowest eigenpairs, by SLEPc
"""

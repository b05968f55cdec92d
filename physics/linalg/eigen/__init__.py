"""The lowest pairs of K x = lambda M x, K symmetric and at least semi-definite, M positive definite.

    pairs      what is asked and answered: problem, pairs, residuals, clusters
    krylov     block Lanczos
    dissected  the factor by nested dissection for blocks of vectors, and its inertia
    mumps      SLEPc's Krylov-Schur with MUMPS's factor
    direct     with one of these factors: shift and invert, counted by inertia, refined in extended precision
    iterated   without one: SLEPc's LOBPCG and Davidson's method with multigrid
    lowest     `lowest_pairs`, which chooses between the two by size
"""

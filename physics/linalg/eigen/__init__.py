"""The lowest pairs of K x = lambda M x, K symmetric and at least semi-definite, M positive definite, by SLEPc.

    pairs      what is asked and answered: problem, pairs, residuals, clusters
    direct     with a factor: shift and invert, counted by inertia, refined in extended precision
    iterated   without one: LOBPCG and Davidson's method with multigrid
    lowest     `lowest_pairs`, which chooses between the two by size
"""

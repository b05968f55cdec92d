"""How does a body swing?

    elastic     free and supported vibration, K x = omega^2 M x
    locking     whether cells of first order are much too stiff for a mode
    laplacian   the modes of the Laplace operator, for flows
"""

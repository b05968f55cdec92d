"""How does a body swing?

    elastic     free and supported vibration, K x = omega^2 M x
    laplacian   the modes of the Laplace operator, for flows
"""

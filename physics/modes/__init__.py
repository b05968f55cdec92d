"""How does a body vibrate?

    elastic     free and supported vibration, K x = omega^2 M x
    locking     whether cells of first order are much too stiff for a mode
    loaded      the stiffness with which a loaded body vibrates
    laplacian   the modes of the Laplace operator, for flows
"""

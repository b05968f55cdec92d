"""How good is a prediction?

    verify    its error, residual force, energy, penetration, reaction and mesh, against the scene it is of
    correct   what Newton steps make of it
"""

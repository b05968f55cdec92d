"""How good is a prediction?

    figures   what each figure is called, its unit, what it is, and what all of them say
    verify    its error, residual force, energy, penetration, reaction and mesh, against the scene it is of
    correct   what Newton steps make of it
"""

"""How good is a prediction?

    verify    its error, residual force, energy, penetration, reaction and mesh, against the scene it is of
    starts    where the steps of a frame begin
    correct   what Newton steps make of it
"""
